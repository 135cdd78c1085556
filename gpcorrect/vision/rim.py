"""A ball's outline to a fraction of a pixel, and the ray to its centre.

The rays that touch a ball form a circular cone about the ray to its centre: d . m = 1 with m = axis / cos(half angle).
Fitting that cone to undistorted rim points is linear, and free of two biases that a circle or an ellipse has: the
centre of a ball's outline is not the image of its centre, and a distorted outline is no ellipse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import BoolArray, FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.settings import DEFAULT, BallSettings

TINY = 1e-9  # keeps the division finite where ball and background are alike; contrast leaves such rays out
UNKNOWN = 1e3  # variance of the light of a channel that is clipped: no part in what tells ball from background


@dataclass(frozen=True, eq=False)
class Outline:
    """A ball in one picture.

    Parameters
    ----------
    pixel : (2,) array, where its centre appears, px
    ray : (2,) array, the same, undistorted, on the plane one unit before the lens
    covariance : (2, 2) array, of `ray`
    half_angle : float, of the cone of rays that touch it, rad
    radius : float, of the outline, px
    arc : float, fraction of the rim that was seen
    rms_px : float, of the rim points about the fitted outline
    """

    pixel: FloatArray
    ray: FloatArray
    covariance: FloatArray
    half_angle: float
    radius: float
    arc: float
    rms_px: float


def outline(
    image: Image, circle: FloatArray, lens: Intrinsics, settings: BallSettings = DEFAULT.balls
) -> Outline | None:
    """Refine a circle to the ball's outline.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    circle : (3,) array, where the ball was found: u, v, radius, px
    lens : Intrinsics, of the camera
    settings : BallSettings, what a rim is

    Returns
    -------
    Outline or None
        None when too little of a rim is there.
    """
    found = None
    if not circle[2] >= settings.least_outline_px:
        return None
    for reach in settings.reaches:
        pixels, blur_px = _rim_points(image, circle, reach, settings)
        if len(pixels) < settings.least_arc * settings.rays:
            return None
        found = fit_cone(lens.normalised(pixels), lens, settings, blur_px)
        if found is None:
            return None
        start, circle = circle, np.array([*found.pixel, found.radius])
        if np.abs(circle - start).max() < settings.converged_px:
            break
    return found


def _rim_points(image: Image, circle: FloatArray, reach: float, settings: BallSettings) -> tuple[FloatArray, float]:
    """Points `(n, 2)` at which the colour changes fastest from the ball's to the background's, and the rim's blur, px.

    `reach` is how far inside and outside the circle to sample, along rays, as a fraction of its radius. The blur is a
    standard deviation, the median of the rays.
    """
    u, v, radius = circle
    angles = np.linspace(0.0, 2.0 * np.pi, settings.rays, endpoint=False)[:, None]
    cos, sin = np.cos(angles), np.sin(angles)
    half = max(reach * radius, 2.5)
    r = np.arange(max(radius - half - 1.0, 0.5), radius + half + 1.0, settings.step_px)
    where = (u + r * cos).astype(np.float32), (v + r * sin).astype(np.float32)
    colours = cv2.remap(image, *where, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    end_u, end_v = where[0][:, -1], where[1][:, -1]  # the outer ends lie farthest out
    inside = (end_u > 0) & (end_u < image.shape[1] - 1) & (end_v > 0) & (end_v < image.shape[0] - 1)
    inner, outer = np.searchsorted(r, (max(radius - 0.4 * half, r[0]), radius + 0.4 * half), side="right")
    along, contrast = _towards_ball(colours, inner, outer, settings)
    slope = -np.diff(along, axis=1)
    slope[:, 1:-1] = 0.25 * slope[:, :-2] + 0.5 * slope[:, 1:-1] + 0.25 * slope[:, 2:]
    peak = np.argmax(slope[:, 1:-1], axis=1) + 1
    rows = np.arange(len(slope))
    before, top, after = slope[rows, peak - 1], slope[rows, peak], slope[rows, peak + 1]
    bend = before - 2.0 * top + after  # the top of the parabola through the peak and its neighbours
    offset = np.where(bend < -1e-9, 0.5 * (before - after) / np.where(bend < -1e-9, bend, 1.0), 0.0)
    at = r[0] + settings.step_px * (peak + 0.5 + np.clip(offset, -1.0, 1.0))
    good = (contrast > settings.contrast) & (top > settings.least_slope) & inside
    blur_px = settings.step_px / np.sqrt(2.0 * np.pi) / float(np.median(top[good])) if good.any() else 0.0
    return np.stack([u + at * cos[:, 0], v + at * sin[:, 0]], axis=1)[good].astype(np.float64), blur_px


def _towards_ball(colours: Image, inner: int, outer: int, settings: BallSettings) -> tuple[FloatArray, FloatArray]:
    """Light along each ray, from the background's (0) to the ball's (1), and how many standard deviations that spans.

    The first `inner` samples of a ray are the ball, those from `outer` on what is behind it. Of all mixtures of the
    three channels this is the one in which they differ most against what varies along the ball (Fisher 1936): shading
    that changes towards the rim, noise. Channels that are clipped between the two do not count: what is cut off changes
    fastest beside the rim.
    """
    light = _light(settings.gamma)[colours]
    ball, ground = light[:, :inner].mean(axis=1), light[:, outer:].mean(axis=1)
    clipped = (colours[:, inner:outer] >= settings.clipped).any(axis=1)
    shading = light[:, :inner] - ball[:, None]
    scatter = shading.swapaxes(1, 2) @ shading / inner
    scatter = scatter + (settings.least_scatter**2 + UNKNOWN * clipped)[:, None] * np.eye(3)
    difference = ball - ground
    mixture = np.linalg.solve(scatter, difference[..., None])
    apart = (difference * mixture[..., 0]).sum(axis=1)
    above = ((light - ground[:, None]) @ mixture)[..., 0]
    return above / np.maximum(apart, TINY)[:, None], np.sqrt(np.maximum(apart, 0.0))


@cache
def _light(gamma: float) -> FloatArray:
    """How much light each of 256 grey levels stands for, 0 to 1."""
    return np.asarray((np.arange(256) / 255.0) ** gamma, dtype=np.float32)


def fit_cone(
    points: FloatArray, lens: Intrinsics, settings: BallSettings = DEFAULT.balls, blur_px: float = 1.0
) -> Outline | None:
    """Fit the cone of touching rays to the rim points that agree on one; None when they are too few.

    Parameters
    ----------
    points : (n, 2) array, undistorted, on the plane one unit before the lens
    lens : Intrinsics
    settings : BallSettings
    blur_px : float, standard deviation of the rim's blur
    """
    d = np.column_stack([points, np.ones(len(points))])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    used = np.ones(len(d), dtype=bool)
    m, off = _cone(d, used, lens)
    if float(np.abs(off).max()) >= settings.clean_px:
        fewest, consensus = settings.least_arc * settings.rays, _consensus(d, lens, settings)
        if consensus is None or consensus.sum() < max(fewest, 3):
            return None
        used = consensus
        for _ in range(3):
            m, off = _cone(d, used, lens)
            middle = np.count_nonzero(used) // 2
            scale = MAD_TO_STD * float(np.partition(np.abs(off[used]), middle)[middle])
            near = np.abs(off) < 3.0 * max(settings.inlier_px, scale)
            if near.sum() < fewest:
                return None
            if (near == used).all():
                break
            used = near
    return _outline(d[used], m, off[used], lens, settings, blur_px)


def _cone(d: FloatArray, used: BoolArray, lens: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Least-squares cone through some rays, and how far (px) every ray is from it."""
    chosen = d[used]
    m: FloatArray = np.linalg.solve(chosen.T @ chosen + 1e-15 * np.eye(3), chosen.sum(axis=0))
    return m, lens.focal * _distances(d, m)


def _distances(d: FloatArray, m: FloatArray) -> FloatArray:
    """Angles (rad, small) of rays `(n, 3)` from cones `(..., 3)`, positive inside: `(..., n)`."""
    sine = np.sqrt(np.maximum((m * m).sum(axis=-1) - 1.0, 1e-12))  # |m| sin(half angle)
    return np.asarray((m @ d.T - 1.0) / sine[..., None])


def _consensus(d: FloatArray, lens: Intrinsics, settings: BallSettings) -> BoolArray | None:
    """Rim points that most agree on: of the cones through three points each, spread around the rim, the best."""
    n = len(d)
    first = np.arange(n)
    thirds, fifths = (np.stack([first, first + n // k, first + 2 * n // k], axis=1) for k in (3, 5))
    triples = d[np.concatenate([thirds[: n // 3 + 1], fifths[::2]]) % n]
    triples = triples[np.abs(np.linalg.det(triples)) > 1e-12]
    m = np.linalg.solve(triples, np.ones((len(triples), 3, 1)))[..., 0]  # each of the three has d . m = 1
    m = m[(m * m).sum(axis=1) > 1.0]
    if not len(m):
        return None
    off = lens.focal * np.abs(_distances(d, m))
    best = np.argmin(np.minimum(off, 2.0 * settings.inlier_px).sum(axis=1))
    return np.asarray(off[best] < 3.0 * settings.inlier_px)


def _outline(
    d: FloatArray, m: FloatArray, off: FloatArray, lens: Intrinsics, settings: BallSettings, blur_px: float
) -> Outline | None:
    """Outline of a cone `m` fitted to rays `d`, which are `off` px from it."""
    length = float(np.linalg.norm(m))
    if length <= 1.0 or m[2] <= 0:
        return None
    half = float(np.arccos(1.0 / length))
    rms = float(np.sqrt(np.mean(off**2)))
    # Errors of the rim that repeat once around it move the centre and leave nothing to see. Those that repeat k times
    # show, and have 1 / k of the power (flicker noise) above the white noise, of which `rms` is nearly all.
    power = np.abs(np.fft.rfft(off)[2 : settings.harmonics + 1]) ** 2 / len(off)
    k = np.arange(2, 2 + len(power))
    once = float(k @ power) / max(len(k) - 1, 1) - (k.mean() - 1.0) * rms**2
    noise = np.sqrt(max(rms**2, once, 0.05**2)) / lens.focal
    # d . m = 1: a rim point that is off by an angle e misses by e |m| sin(half).
    covariance_m = (noise * length * np.sin(half)) ** 2 * np.linalg.inv(d.T @ d)
    J = np.array([[1.0, 0.0, -m[0] / m[2]], [0.0, 1.0, -m[1] / m[2]]]) / m[2]
    ray = m[:2] / m[2]
    covariance = J @ covariance_m @ J.T + (settings.floor_px * blur_px**2 / lens.focal) ** 2 * np.eye(2)
    pixel = lens.pixels(np.array([*ray, 1.0]))[0]
    return Outline(pixel, ray, covariance, half, lens.focal * np.tan(half), len(d) / settings.rays, rms)
