"""What several cameras agree on: balls among candidates, which clutter is not, and which views of a ball are trusted.

Views are trusted as in Peng et al. 2020, Sec. III-B.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.pose import Located, common_perpendicular, triangulate
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import Reason
from gpcorrect.vision.settings import AgreementSettings, ViewSettings
from gpcorrect.vision.target import Target


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A ball somewhere."""

    position: FloatArray  # (3,) tracker frame, m
    views: Mapping[int, Outline]  # that agree, by the number of the camera
    radius: float  # mean over the views, m
    error_px: float  # RMS reprojection error


def hypotheses(
    cameras: Sequence[Camera],
    candidates: Sequence[Sequence[Outline]],
    radius: float | None,
    settings: AgreementSettings,
) -> list[Hypothesis]:
    """Return places at which at least two cameras agree on a ball of one size: more cameras first, then less error.

    Parameters
    ----------
    cameras : sequence of Camera
    candidates : sequence of sequence of Outline, what each may see of the ball
    radius : float or None, of the ball, m, when known
    settings : AgreementSettings
    """
    found = []
    for i, j in itertools.combinations(range(len(cameras)), 2):
        for a, b in itertools.product(candidates[i], candidates[j]):
            hypothesis = _grown(cameras, candidates, {i: a, j: b}, radius, settings)
            if hypothesis is not None:
                found.append(hypothesis)
    found.sort(key=lambda h: (-len(h.views), h.error_px))
    distinct: list[Hypothesis] = []
    for h in found:
        if all(float(np.linalg.norm(h.position - d.position)) > settings.distinct for d in distinct):
            distinct.append(h)
    return distinct


def _grown(
    cameras: Sequence[Camera],
    candidates: Sequence[Sequence[Outline]],
    pair: dict[int, Outline],
    radius: float | None,
    settings: AgreementSettings,
) -> Hypothesis | None:
    """Start from two views and add every other camera's that agrees."""
    i, j = pair
    rays = [cameras[k].directions(np.array([*o.ray, 1.0]))[0] for k, o in pair.items()]
    try:
        point, _ = common_perpendicular(cameras[i].position, rays[0], cameras[j].position, rays[1])
    except DegenerateError:
        return None

    def alike(a: float, b: float) -> bool:
        return abs(a - b) < settings.size * max(a, b)

    sizes = [_size(cameras[k], o, point) for k, o in pair.items()]
    if not alike(*sizes) or (radius is not None and not all(alike(size, radius) for size in sizes)):
        return None
    if max(_miss(cameras[k], o, point) for k, o in pair.items()) > settings.reprojection_px:
        return None
    views, size = dict(pair), radius or float(np.mean(sizes))
    for k, options in enumerate(candidates):
        if k not in pair:
            near = [(_miss(cameras[k], o, point), o) for o in options if alike(_size(cameras[k], o, point), size)]
            miss, best = min(near, key=lambda option: option[0], default=(np.inf, None))
            if best is not None and miss < settings.reprojection_px:
                views[k] = best
    located = triangulate(
        [cameras[k] for k in views],
        np.array([o.ray for o in views.values()]),
        np.array([o.covariance for o in views.values()]),
    )
    error = float(np.sqrt(np.mean((located.residuals**2).sum(axis=1))))
    size = float(np.mean([_size(cameras[k], o, located.position) for k, o in views.items()]))
    return Hypothesis(located.position, views, size, error)


def _size(camera: Camera, found: Outline, point: FloatArray) -> float:
    """Radius (m) of a ball at `point` with this outline."""
    return float(np.linalg.norm(point - camera.position) * np.sin(found.half_angle))


def _miss(camera: Camera, found: Outline, point: FloatArray) -> float:
    """Undistorted distance (px) between an outline's centre and a point; infinite for a point behind the camera."""
    x, y, z = camera.local(point)[0]
    return float(camera.intrinsics.focal * np.hypot(x / z - found.ray[0], y / z - found.ray[1])) if z > 0 else np.inf


class LoneBall:
    """Finds a target of one ball again, which has no shape by which it could be known from a thing like it.

    Where it was expected, it is the ball. Elsewhere, or where several places are possible from the start, it is
    believed when it alone moves: what lies still is not on the tool.
    """

    def __init__(self, settings: AgreementSettings) -> None:
        self.settings = settings
        self._earlier: list[Hypothesis] = []
        self._time = -np.inf
        self._tracked = False

    def choose(self, options: Sequence[Hypothesis], time: float, expected: FloatArray | None) -> Hypothesis | None:
        """Return the ball among places that several cameras agree on, or None while that is open.

        Parameters
        ----------
        options : sequence of Hypothesis, the best first
        time : float, s
        expected : (3,) array or None, where the ball should be, m; None when it is not known
        """
        settings = self.settings
        seen = [h for h in options if len(h.views) >= min(3, len(options[0].views))]
        earlier, self._earlier, since, self._time = self._earlier, seen, time - self._time, time
        if expected is not None:
            near = [h for h in options if float(np.linalg.norm(h.position - expected)) < settings.near]
            if near:
                return near[0]
        if not self._tracked and len(seen) == 1:
            self._tracked = True
            return seen[0]
        moved = [min((float(np.linalg.norm(h.position - e.position)) for e in earlier), default=np.inf) for h in seen]
        moving = [h for h, by in zip(seen, moved, strict=True) if settings.still < by < settings.fastest * since]
        if len(moving) != 1:  # of two that move, nothing says which is the ball
            return None
        self._tracked = True
        return moving[0]


def acquire(
    cameras: Sequence[Camera],
    target: Target,
    candidates: Sequence[Sequence[Sequence[Outline]]],
    settings: AgreementSettings,
) -> list[Hypothesis | None]:
    """Return the best place of each ball, or None, such that the distances between the balls are the target's.

    Parameters
    ----------
    cameras : sequence of Camera
    target : Target
    candidates : sequence (cameras) of sequence (balls) of sequence of Outline, what may be each ball in each camera
    settings : AgreementSettings
    """
    options: list[list[Hypothesis | None]] = []
    for b, ball in enumerate(target.balls):
        found = hypotheses(cameras, [camera[b] for camera in candidates], ball.radius, settings)
        options.append([*found[: settings.places], None])
    best: list[Hypothesis | None] = [None] * len(target.balls)
    best_score = (0, 0, 0.0)
    for chosen in itertools.product(*options):
        balls = [h for h in chosen if h is not None]
        score = (len(balls), sum(len(h.views) for h in balls), -sum(h.error_px for h in balls))
        if score > best_score and _shape_fits(chosen, target.places, settings):
            best, best_score = list(chosen), score
    return best


def _shape_fits(chosen: Sequence[Hypothesis | None], places: FloatArray, settings: AgreementSettings) -> bool:
    """Whether the distances between the chosen balls are those on the tool."""
    for (a, place_a), (b, place_b) in itertools.combinations(zip(chosen, places, strict=True), 2):
        known = float(np.linalg.norm(place_a - place_b))
        limit = settings.shape + settings.shape_fraction * known
        if a is not None and b is not None and abs(np.linalg.norm(a.position - b.position) - known) > limit:
            return False
    return True


@dataclass
class View:
    """One ball in one camera."""

    effective: bool = False  # whether it is trusted; otherwise it is suspended
    reason: Reason = Reason.NOT_FOUND  # why it is suspended
    outline: Outline | None = None  # what was found in this frame
    good: int = 0  # frames in which a suspended view agreed with the others
    delay: float = 0.0  # by how much later than the frame's time it was taken, s
    # (2,) by how much its ray moved since the frame's time, as far as the motion is known
    shift: FloatArray = field(default_factory=lambda: np.zeros(2))
    slack_px: float = 0.0  # how uncertain `shift` is

    def suspend(self, reason: Reason) -> None:
        """Trust this view no more, until it has been good for long enough.

        Parameters
        ----------
        reason : Reason
        """
        self.effective, self.reason, self.good = False, reason, 0

    def admit(self) -> None:
        """Trust this view."""
        self.effective, self.reason = True, Reason.NONE


def agree(
    views: Sequence[View], cameras: Sequence[Camera], settings: ViewSettings, *, settled: bool
) -> tuple[Located | None, list[float]]:
    """Locate a ball from its trusted views; suspend those against the others, and count good frames.

    Parameters
    ----------
    views : sequence of View, of one ball, one a camera; changed in place
    cameras : sequence of Camera
    settings : ViewSettings
    settled : bool, where fewer than two views are trusted, take all that see the ball

    Returns
    -------
    Located or None
        Where the ball is, at the frame's time.
    list of float
        Its radius as each trusted view has it, m.
    """
    seen = [k for k, view in enumerate(views) if view.outline is not None]
    trusted = [k for k in seen if views[k].effective]
    trusted = _consensus(seen if len(trusted) < 2 and settled else trusted, views, cameras, settings)
    point, sizes = _located(trusted, views, cameras), []
    for k in seen if point is not None else ():
        view, outline = views[k], views[k].outline
        assert outline is not None
        assert point is not None
        local = cameras[k].local(point.position)[0]
        off = cameras[k].intrinsics.focal * float(np.linalg.norm(outline.ray - view.shift - local[:2] / local[2]))
        if k in trusted:
            view.admit()
            sizes.append(float(np.linalg.norm(local) * np.sin(outline.half_angle)))
        elif not off <= limit_px(view, settings) - settings.return_px:
            view.suspend(Reason.AGAINST_OTHERS)
        else:
            view.good, view.reason = view.good + 1, Reason.COMING_BACK
            if view.good >= settings.good_frames:
                view.admit()
    return point, sizes


def limit_px(view: View, settings: ViewSettings) -> float:
    """Return how far (px) a view may be from where the others put the ball.

    Parameters
    ----------
    view : View
    settings : ViewSettings
    """
    return settings.reprojection_px + min(2.0 * view.slack_px, settings.motion_px)


def _consensus(seen: list[int], views: Sequence[View], cameras: Sequence[Camera], settings: ViewSettings) -> list[int]:
    """Leave out the worst view until the others agree; of two that disagree neither is trusted."""
    while len(seen) >= 2:
        point = _located(seen, views, cameras)
        if point is None:
            return []
        off = np.linalg.norm(point.residuals, axis=1)
        over = off / np.array([limit_px(views[k], settings) for k in seen])
        if float(over.max()) <= 1.0:
            return seen
        if len(seen) == 2:
            for k in seen:
                views[k].suspend(Reason.AGAINST_OTHERS)
            return []
        rests = [seen[:i] + seen[i + 1 :] for i in range(len(seen))]  # without the worst the others agree best
        points = [_located(rest, views, cameras) for rest in rests]
        left = [np.inf if p is None else np.linalg.norm(p.residuals, axis=1).max() for p in points]
        seen = rests[int(np.argmin(left)) if np.isfinite(left).any() else int(np.argmax(over))]
    return []


def _located(seen: Sequence[int], views: Sequence[View], cameras: Sequence[Camera]) -> Located | None:
    """Return where some views put the ball; None where they cannot."""
    found = [(cameras[k], views[k].shift, o) for k in seen if (o := views[k].outline) is not None]
    if len(found) < 2:
        return None
    rays, covariances = np.array([o.ray - shift for _, shift, o in found]), np.array([o.covariance for *_, o in found])
    try:
        return triangulate([camera for camera, *_ in found], rays, covariances)
    except DegenerateError:
        return None
