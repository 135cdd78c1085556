"""Finds the balls among candidates in all cameras: what several cameras agree on in space is a ball, clutter is not."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.target import Target
from gpcorrect.vision.triangulate import common_perpendicular, triangulate

__all__ = ["Hypothesis", "acquire", "hypotheses"]

REPROJECTION_PX = 3.0  # within which another camera agrees, at first sight
SIZE = 0.3  # share by which two cameras' radii of one ball may differ
FEW = 4  # hypotheses a ball that are tried together
SHAPE = 0.004  # m by which distances between balls may miss


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A ball somewhere.

    Parameters
    ----------
    position : (3,) array
        Tracker frame, m.
    views : mapping of camera index to Outline
        That agree.
    radius : float
        As they tell it, m.
    error_px : float
        RMS reprojection error.
    """

    position: FloatArray
    views: Mapping[int, Outline]
    radius: float
    error_px: float

    @property
    def rank(self) -> tuple[int, float]:
        """More cameras first, then less error."""
        return (-len(self.views), self.error_px)


def hypotheses(
    cameras: Sequence[Camera], candidates: Sequence[Sequence[Outline]], radius: float | None
) -> list[Hypothesis]:
    """Return places at which at least two cameras agree on a ball of one size, the best first.

    Parameters
    ----------
    cameras : sequence of Camera
        All cameras.
    candidates : sequence of sequence of Outline
        What each may see of the ball.
    radius : float or None
        Of the ball, m, when known.
    """
    found = []
    for i, j in itertools.combinations(range(len(cameras)), 2):
        for a, b in itertools.product(candidates[i], candidates[j]):
            hypothesis = _grown(cameras, candidates, {i: a, j: b}, radius)
            if hypothesis is not None:
                found.append(hypothesis)
    found.sort(key=lambda h: h.rank)
    distinct: list[Hypothesis] = []
    for h in found:
        if all(float(np.linalg.norm(h.position - d.position)) > 0.003 for d in distinct):
            distinct.append(h)
    return distinct


def _grown(
    cameras: Sequence[Camera], candidates: Sequence[Sequence[Outline]], pair: dict[int, Outline], radius: float | None
) -> Hypothesis | None:
    """Start from two views and add every other camera's that agrees."""
    i, j = pair
    rays = [cameras[k].directions(np.array([*o.ray, 1.0]))[0] for k, o in pair.items()]
    try:
        point, _ = common_perpendicular(cameras[i].position, rays[0], cameras[j].position, rays[1])
    except DegenerateError:
        return None
    sizes = [_size(cameras[k], o, point) for k, o in pair.items()]
    if min(_depth(cameras[k], point) for k in pair) <= 0 or not _same(sizes[0], sizes[1]):
        return None
    if radius is not None and not all(_same(size, radius) for size in sizes):
        return None
    if max(_miss(cameras[k], o, point) for k, o in pair.items()) > REPROJECTION_PX:
        return None
    views = dict(pair)
    for k, options in enumerate(candidates):
        agreeing = [
            o
            for o in options
            if k not in views
            and _depth(cameras[k], point) > 0
            and _miss(cameras[k], o, point) < REPROJECTION_PX
            and _same(_size(cameras[k], o, point), radius or float(np.mean(sizes)))
        ]
        if agreeing:
            views[k] = min(agreeing, key=lambda o: _miss(cameras[k], o, point))
    located = triangulate(
        [cameras[k] for k in views],
        np.array([o.ray for o in views.values()]),
        np.array([o.covariance for o in views.values()]),
    )
    error = float(np.sqrt(np.mean((located.residuals**2).sum(axis=1))))
    size = float(np.mean([_size(cameras[k], o, located.position) for k, o in views.items()]))
    return Hypothesis(located.position, views, size, error)


def _depth(camera: Camera, point: FloatArray) -> float:
    return float(camera.local(point)[0, 2])


def _size(camera: Camera, found: Outline, point: FloatArray) -> float:
    """Radius (m) of a ball at `point` with this outline."""
    return float(np.linalg.norm(point - camera.position) * np.sin(found.half_angle))


def _same(a: float, b: float) -> bool:
    return abs(a - b) < SIZE * max(a, b)


def _miss(camera: Camera, found: Outline, point: FloatArray) -> float:
    local = camera.local(point)[0]
    return float(camera.intrinsics.focal * np.linalg.norm(local[:2] / local[2] - found.ray))


def acquire(
    cameras: Sequence[Camera], target: Target, candidates: Sequence[Sequence[Sequence[Outline]]]
) -> list[Hypothesis | None]:
    """Return the best place of each ball, or None: those sets first whose distances are the target's.

    Parameters
    ----------
    cameras : sequence of Camera
        All cameras.
    target : Target
        The balls.
    candidates : sequence (cameras) of sequence (balls) of sequence of Outline
        What may be each ball in each camera.
    """
    options: list[list[Hypothesis | None]] = []
    for b, ball in enumerate(target.balls):
        found = hypotheses(cameras, [camera[b] for camera in candidates], ball.radius)
        options.append([*found[:FEW], None])
    if len(target.balls) == 1:
        return [options[0][0]]
    best: list[Hypothesis | None] = [None] * len(target.balls)
    best_score = (0, 0, 0.0)
    for chosen in itertools.product(*options):
        if not _shape_fits(chosen, target.places):
            continue
        balls = [h for h in chosen if h is not None]
        score = (len(balls), sum(len(h.views) for h in balls), -sum(h.error_px for h in balls))
        if score > best_score:
            best, best_score = list(chosen), score
    return best


def _shape_fits(chosen: Sequence[Hypothesis | None], places: FloatArray) -> bool:
    """Whether the distances between the chosen balls are those on the tool."""
    for (i, a), (j, b) in itertools.combinations(enumerate(chosen), 2):
        if a is None or b is None:
            continue
        known = float(np.linalg.norm(places[i] - places[j]))
        if abs(float(np.linalg.norm(a.position - b.position)) - known) > SHAPE + 0.05 * known:
            return False
    return True
