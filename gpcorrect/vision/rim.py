"""A ball's outline to a fraction of a pixel, and the ray to its centre.

The rays that touch a ball form a circular cone about the ray to its centre: d . m = 1 with m = axis / cos(half angle).
Fitting that cone to undistorted rim points is linear, and free of two biases that a circle or an ellipse has: the
centre of a ball's outline is not the image of its centre, and a distorted outline is no ellipse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import BoolArray, FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.opencv import Image, cv2

__all__ = ["Outline", "fit_cone", "outline", "rim_points"]

RAYS = 64
ANGLES = np.linspace(0.0, 2.0 * np.pi, RAYS, endpoint=False)
COS, SIN = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
LEAST_RADIUS = 2.0  # px
STEP = 0.5  # px between samples along a ray
CONTRAST = 12.0  # grey levels between ball and background, of all channels, without which a rim point means nothing
LEAST_ARC = 0.30  # of the rim that must be seen
NEAR = 0.35  # px: rim points farther than three times this from the cone are not of the ball
CLEAN = 0.8  # px: when no rim point is farther off, none needs to be left out
SETTLED = 0.6  # px: a circle that was this good needs no second look
FLOOR = 0.03  # px: what systematic errors leave of any centre


@dataclass(frozen=True, eq=False)
class Outline:
    """A ball in one picture.

    Parameters
    ----------
    pixel : (2,) array
        Where its centre appears, px.
    ray : (2,) array
        The same, undistorted, on the plane one unit before the lens.
    covariance : (2, 2) array
        Of `ray`.
    half_angle : float
        Of the cone of rays that touch it, rad.
    radius : float
        Of the outline, px.
    arc : float
        Share of the rim that was seen.
    rms_px : float
        Of the rim points about the fitted outline.
    """

    pixel: FloatArray
    ray: FloatArray
    covariance: FloatArray
    half_angle: float
    radius: float
    arc: float
    rms_px: float


def outline(image: Image, circle: FloatArray, lens: Intrinsics) -> Outline | None:
    """Refine a circle (u, v, radius; px) to the ball's outline; None when too little of a rim is there.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        The picture.
    circle : (3,) array
        Where the ball was found.
    lens : Intrinsics
        Of the camera.
    """
    found = None
    if not circle[2] >= LEAST_RADIUS:
        return None
    for reach in (0.45, 0.25):
        pixels = rim_points(image, circle, reach)
        if len(pixels) < LEAST_ARC * RAYS:
            return None
        found = fit_cone(lens.normalised(pixels), lens)
        if found is None:
            return None
        moved = float(np.abs(np.array([*found.pixel, found.radius]) - circle).max())
        circle = np.array([*found.pixel, found.radius])
        if moved < SETTLED:
            break
    return found


def rim_points(image: Image, circle: FloatArray, reach: float) -> FloatArray:
    """Points `(n, 2)` at which the colour changes fastest from the ball's to the background's, along rays.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        The picture.
    circle : (3,) array
        Centre and radius, px, to within `reach`.
    reach : float
        How far to look inside and outside the circle, as a share of the radius.
    """
    u, v, radius = circle
    half = max(reach * radius, 2.5)
    r = np.arange(max(radius - half - 1.0, 0.5), radius + half + 1.0, STEP)
    where = (u + r * COS).astype(np.float32), (v + r * SIN).astype(np.float32)
    colours = cv2.remap(image, *where, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    inside = _inside(where, image.shape)
    along, contrast = _towards_ball(colours, r, radius, half)
    slope = -np.diff(along, axis=1)
    slope[:, 1:-1] = 0.25 * slope[:, :-2] + 0.5 * slope[:, 1:-1] + 0.25 * slope[:, 2:]
    peak = np.argmax(slope[:, 1:-1], axis=1) + 1
    offset, height = _parabola(slope, peak)
    at = r[0] + STEP * (peak + 0.5 + offset)
    good = (contrast > CONTRAST) & (height > 0.04) & inside
    return np.stack([u + at * COS[:, 0], v + at * SIN[:, 0]], axis=1)[good].astype(np.float64)


def _inside(where: tuple[FloatArray, FloatArray], shape: tuple[int, ...]) -> BoolArray:
    """Rays that lie within the picture along their whole length."""
    u, v = where[0][:, -1], where[1][:, -1]  # the outer ends lie farthest out
    within: BoolArray = (u > 0) & (u < shape[1] - 1) & (v > 0) & (v < shape[0] - 1)
    return within


def _towards_ball(colours: FloatArray, r: FloatArray, radius: float, half: float) -> tuple[FloatArray, FloatArray]:
    """Colours along each ray, measured from the background (0) to the ball (1), and the contrast of the two."""
    ball = colours[:, r <= max(radius - 0.4 * half, r[0])].mean(axis=1)
    ground = colours[:, r > radius + 0.4 * half].mean(axis=1)
    difference = ball - ground
    length2 = (difference**2).sum(axis=1)
    along = ((colours - ground[:, None]) * difference[:, None]).sum(axis=2) / np.maximum(length2, 1.0)[:, None]
    return along, np.sqrt(length2)


def _parabola(slope: FloatArray, peak: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offset in samples, and height, of the top of the parabola through the peak and its neighbours."""
    rows = np.arange(len(slope))
    before, top, after = slope[rows, peak - 1], slope[rows, peak], slope[rows, peak + 1]
    bend = before - 2.0 * top + after
    offset = np.where(bend < -1e-9, 0.5 * (before - after) / np.where(bend < -1e-9, bend, 1.0), 0.0)
    return np.clip(offset, -1.0, 1.0), top


def fit_cone(points: FloatArray, lens: Intrinsics) -> Outline | None:
    """Fit the cone of touching rays to undistorted rim points `(n, 2)`; None when too few agree on one."""
    d = np.empty((len(points), 3))
    d[:, :2], d[:, 2] = points, 1.0
    d /= np.sqrt((d * d).sum(axis=1))[:, None]
    m, left = _cone(d, np.ones(len(d), dtype=bool), lens)
    if float(np.abs(left).max()) < CLEAN:
        return _outline(d, m, left, lens)
    keep = _consensus(d, lens.focal)
    if keep is None:
        return None
    for _ in range(3):
        m, left = _cone(d, keep, lens)
        near = np.abs(left) < 3.0 * max(NEAR, 1.4826 * float(np.median(np.abs(left[keep]))))
        if near.sum() < LEAST_ARC * RAYS:
            return None
        if (near == keep).all():
            break
        keep = near
    return _outline(d[keep], m, left[keep], lens)


def _cone(d: FloatArray, keep: BoolArray, lens: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Least-squares cone through some rays, and how far (px) every ray is from it."""
    kept = d[keep]
    m: FloatArray = np.linalg.solve(kept.T @ kept + 1e-15 * np.eye(3), kept.sum(axis=0))
    return m, lens.focal * _distances(d, m)


def _distances(d: FloatArray, m: FloatArray) -> FloatArray:
    """Angles (rad, small) of rays `(n, 3)` from cones `(..., 3)`, positive inside: `(..., n)`."""
    sine = np.sqrt(np.maximum((m * m).sum(axis=-1) - 1.0, 1e-12))  # |m| sin(half angle)
    gaps: FloatArray = (m @ d.T - 1.0) / sine[..., None]
    return gaps


def _consensus(d: FloatArray, focal: float) -> BoolArray | None:
    """Rim points that most agree on: cones through three points each, spread around the rim."""
    n = len(d)
    first = np.arange(n)
    picks = (
        np.concatenate(
            [
                np.stack([first, first + n // 3, first + 2 * n // 3], axis=1)[: n // 3 + 1],
                np.stack([first, first + n // 5, first + 2 * n // 5], axis=1)[::2],
            ]
        )
        % n
    )
    m, real = _through_three(d[picks])
    if not real.any():
        return None
    off = focal * np.abs(_distances(d, m[real]))
    best = np.argmin(np.minimum(off, 2.0 * NEAR).sum(axis=1))
    keep: BoolArray = off[best] < 3.0 * NEAR
    return keep if keep.sum() >= max(LEAST_ARC * RAYS, 3) else None


def _through_three(rays: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Cones `(k, 3)` through three rays each `(k, 3, 3)`, by Cramer's rule, and which of them are cones."""
    a, b, c = rays[:, 0], rays[:, 1], rays[:, 2]
    bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    volume = (a * bc).sum(axis=1)
    solid = np.abs(volume) > 1e-12
    m = (bc + ca + ab) / np.where(solid, volume, 1.0)[:, None]
    real: BoolArray = solid & ((m * m).sum(axis=1) > 1.0)
    return m, real


def _outline(d: FloatArray, m: FloatArray, left: FloatArray, lens: Intrinsics) -> Outline | None:
    length = float(np.linalg.norm(m))
    if length <= 1.0 or m[2] <= 0:
        return None
    half = float(np.arccos(1.0 / length))
    rms = float(np.sqrt(np.mean(left**2)))
    noise = max(rms, 0.05) / lens.focal
    # d . m = 1: a rim point that is off by an angle e misses by e |m| sin(half).
    covariance_m = (noise * length * np.sin(half)) ** 2 * np.linalg.inv(d.T @ d)
    J = np.array([[1.0, 0.0, -m[0] / m[2]], [0.0, 1.0, -m[1] / m[2]]]) / m[2]
    ray = m[:2] / m[2]
    covariance = J @ covariance_m @ J.T + (FLOOR / lens.focal) ** 2 * np.eye(2)
    pixel = lens.pixels(np.array([*ray, 1.0]))[0]
    return Outline(pixel, ray, covariance, half, lens.focal * np.tan(half), len(d) / RAYS, rms)
