"""Points from rays: the paper's estimate, and least squares on pixels."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera

LEAST_ANGLE = np.deg2rad(1.0)  # between two rays: one pixel of error is then a tenth of the distance in depth
USUAL_NOISE_PX = 0.1  # of a centre without a covariance: what this package's outlines have
STEPS, CONVERGED = 10, 1e-9  # steps of Gauss-Newton, which takes three or four, and its last step (m and rad)
LEAST_DEPTH = 1e-9  # m: keeps the projection of a point behind a camera finite


@dataclass(frozen=True, eq=False)
class Located:
    """A point in space."""

    position: FloatArray  # (3,) tracker frame, m
    covariance: FloatArray  # (3, 3) m^2
    residuals: FloatArray  # (k, 2) seen minus reprojected, px, one row a camera


def common_perpendicular(
    origin_a: FloatArray, direction_a: FloatArray, origin_b: FloatArray, direction_b: FloatArray
) -> tuple[FloatArray, float]:
    """Return the midpoint of the common perpendicular of two rays, and its length.

    Parameters
    ----------
    origin_a, direction_a, origin_b, direction_b : (3,) arrays, of the rays, m; directions of any length

    Returns
    -------
    midpoint : (3,) array
        m.
    gap : float
        m.

    Raises
    ------
    DegenerateError
        The rays are nearly parallel.
    """
    a, b = direction_a / np.linalg.norm(direction_a), direction_b / np.linalg.norm(direction_b)
    cosine = float(a @ b)
    sine2 = 1.0 - cosine**2
    if sine2 < np.sin(LEAST_ANGLE) ** 2:
        raise DegenerateError("two rays are nearly parallel: they know no depth.", hint="Set the cameras wider apart.")
    between = origin_b - origin_a
    on_a = origin_a + (between @ a - cosine * (between @ b)) / sine2 * a
    on_b = origin_b + (cosine * (between @ a) - between @ b) / sine2 * b
    return 0.5 * (on_a + on_b), float(np.linalg.norm(on_a - on_b))


def mean_midpoint(origins: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the mean of the midpoints of all pairs of rays: the estimate of Peng et al. 2020.

    Parameters
    ----------
    origins, directions : (k, 3) arrays, of the rays, tracker frame, m; pairs that are nearly parallel are left out

    Returns
    -------
    (3,) array
        m.

    Raises
    ------
    DegenerateError
        No pair of rays crosses.
    """
    midpoints = []
    for i, j in itertools.combinations(range(len(origins)), 2):
        try:
            midpoints.append(common_perpendicular(origins[i], directions[i], origins[j], directions[j])[0])
        except DegenerateError:
            continue
    if not midpoints:
        raise DegenerateError("no two rays cross: a point needs two cameras that look from different sides.")
    return np.asarray(np.mean(midpoints, axis=0))


def triangulate(cameras: Sequence[Camera], rays: FloatArray, covariances: FloatArray | None = None) -> Located:
    """Return the point that reprojects best, each camera weighted by how well it sees it.

    Parameters
    ----------
    cameras : sequence of k Camera, that see the point; at least two
    rays : (k, 2) array
        Undistorted places, on the plane one unit before each lens (:meth:`Intrinsics.normalised` of pixels).
    covariances : (k, 2, 2) array, optional, of `rays`; a tenth of a pixel when absent

    Raises
    ------
    DataError
        Fewer than two cameras.
    DegenerateError
        All rays are nearly parallel.
    """
    if len(cameras) < 2:
        raise DataError(f"a point needs two cameras that see it, got {len(cameras)}.")
    rays = np.asarray(rays, dtype=np.float64)
    T = np.stack([camera.T_camera_tracker for camera in cameras])
    focal = np.array([camera.intrinsics.focal for camera in cameras])
    if covariances is None:
        covariances = (USUAL_NOISE_PX / focal)[:, None, None] ** 2 * np.eye(2)
    local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    R_tracker_camera = np.swapaxes(T[:, :3, :3], 1, 2)
    origins = -(R_tracker_camera @ T[:, :3, 3, None])[..., 0]
    point = mean_midpoint(origins, (R_tracker_camera @ local[..., None])[..., 0])
    weights = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    for _ in range(STEPS):
        residual, J = reprojection(T, point, rays)
        information, right = normal_equations(residual, J, weights)
        step = np.linalg.solve(information, right)
        point = point + step
        if float(np.abs(step).max()) < CONVERGED:
            break
    residual, _ = reprojection(T, point, rays)
    return Located(point, np.linalg.inv(information), residual * focal[:, None])


def reprojection(T: FloatArray, points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals `(k, 2)`, seen minus projected, and Jacobians `(k, 2, 3)` of the projections of points.

    Parameters
    ----------
    T : (k, 4, 4) array, camera from tracker, of each view
    points : (k, 3) or (3,) array, tracker frame, m
    rays : (k, 2) array, where they are seen
    """
    local = np.einsum("kij,kj->ki", T[:, :3, :3], np.broadcast_to(points, (len(T), 3))) + T[:, :3, 3]
    z = np.maximum(local[:, 2], LEAST_DEPTH)[:, None]
    projected = local[:, :2] / z
    return rays - projected, (T[:, :2, :3] - projected[:, :, None] * T[:, 2:3, :3]) / z[:, :, None]


def normal_equations(residual: FloatArray, J: FloatArray, weights: FloatArray) -> tuple[Any, Any]:
    """Return information matrix and right side of a Gauss-Newton step.

    Parameters
    ----------
    residual : (k, 2) array
    J : (k, 2, n) array
    weights : (k, 2, 2) array, inverse covariances
    """
    JW = np.einsum("kij,kil->kjl", J, weights)
    return np.einsum("kjl,klm->jm", JW, J), np.einsum("kjl,kl->j", JW, residual)
