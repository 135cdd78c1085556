"""Points from rays: the paper's midpoint of the common perpendicular, and least squares on the reprojection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera

__all__ = ["Located", "common_perpendicular", "mean_midpoint", "triangulate"]

LEAST_ANGLE = np.deg2rad(1.0)  # between two rays; nearly parallel ones know no depth
STEPS = 8
SETTLED = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Located:
    """A point in space.

    Parameters
    ----------
    position : (3,) array
        Tracker frame, m.
    covariance : (3, 3) array
        m^2.
    residuals : (k, 2) array
        Seen minus reprojected, px, one row a camera.
    """

    position: FloatArray
    covariance: FloatArray
    residuals: FloatArray


def common_perpendicular(
    origin_a: FloatArray, direction_a: FloatArray, origin_b: FloatArray, direction_b: FloatArray
) -> tuple[FloatArray, float]:
    """Return the midpoint `(3,)` of the common perpendicular of two rays, and its length, m.

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
    s = (between @ a - cosine * (between @ b)) / sine2
    t = (cosine * (between @ a) - between @ b) / sine2
    on_a, on_b = origin_a + s * a, origin_b + t * b
    return 0.5 * (on_a + on_b), float(np.linalg.norm(on_a - on_b))


def mean_midpoint(origins: FloatArray, directions: FloatArray) -> FloatArray:
    """Mean `(3,)` of the midpoints of all pairs of rays: the paper's estimate.

    Parameters
    ----------
    origins, directions : (k, 3) arrays
        Of the rays, tracker frame, m; pairs that are nearly parallel are left out.

    Raises
    ------
    DegenerateError
        No pair of rays crosses.
    """
    midpoints = []
    for i in range(len(origins)):
        for j in range(i + 1, len(origins)):
            try:
                midpoints.append(common_perpendicular(origins[i], directions[i], origins[j], directions[j])[0])
            except DegenerateError:
                continue
    if not midpoints:
        raise DegenerateError("no two rays cross: a point needs two cameras that look from different sides.")
    mean: FloatArray = np.mean(midpoints, axis=0)
    return mean


def triangulate(cameras: Sequence[Camera], rays: FloatArray, covariances: FloatArray | None = None) -> Located:
    """Point that reprojects best, each camera weighted by how well it sees it.

    Parameters
    ----------
    cameras : sequence of k Camera
        That see the point; at least two.
    rays : (k, 2) array
        Undistorted places, on the plane one unit before each lens (:meth:`Intrinsics.normalised` of pixels).
    covariances : (k, 2, 2) array, optional
        Of `rays`; a tenth of a pixel when absent.

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
        covariances = (0.1 / focal)[:, None, None] ** 2 * np.eye(2)
    local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    origins = -np.einsum("kji,kj->ki", T[:, :3, :3], T[:, :3, 3])
    point = mean_midpoint(origins, np.einsum("kji,kj->ki", T[:, :3, :3], local))
    weights = np.linalg.inv(covariances)
    for _ in range(STEPS):
        residual, J = _reprojection(T, point, rays)
        JW = np.einsum("kij,kil->kjl", J, weights)
        information = np.einsum("kjl,klm->jm", JW, J)
        step = np.linalg.solve(information, np.einsum("kjl,kl->j", JW, residual))
        point = point + step
        if float(np.abs(step).max()) < SETTLED:
            break
    residual, _ = _reprojection(T, point, rays)
    return Located(point, np.linalg.inv(information), residual * focal[:, None])


def _reprojection(T: FloatArray, point: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals `(k, 2)` seen minus projected, undistorted, and Jacobians `(k, 2, 3)` of the projections."""
    local = T[:, :3, :3] @ point + T[:, :3, 3]
    z = np.maximum(local[:, 2], 1e-9)[:, None]
    projected = local[:, :2] / z
    J = (T[:, :2, :3] - projected[:, :, None] * T[:, 2:3, :3]) / z[:, :, None]
    return rays - projected, J
