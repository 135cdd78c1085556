"""The tool's pose from its balls: the paper's cost by Nelder-Mead, in closed form, and from all sightings at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera

__all__ = ["PoseFit", "Sightings", "pose_closed_form", "pose_from_sightings", "pose_nelder_mead", "triangle_frame"]

STEPS = 10
SETTLED = 1e-9  # m and rad
THIN = 1e-3  # of the balls' spread: on a line they determine no pose


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose of the tool.

    Parameters
    ----------
    T_tracker_tool : (4, 4) array
        m.
    covariance : (6, 6) array
        Position (m), then rotation vector (rad), tracker axes.
    residuals : (k, 2) or (b, 3) array
        Seen minus reprojected in px for sightings; observed minus fitted ball centres in m otherwise.
    """

    T_tracker_tool: FloatArray
    covariance: FloatArray
    residuals: FloatArray


@dataclass(frozen=True, eq=False)
class Sightings:
    """Balls as cameras see them, a row a sighting.

    Parameters
    ----------
    camera, ball : (k,) int arrays
        Which camera sees which ball.
    rays : (k, 2) array
        Undistorted places on the plane one unit before the lens.
    covariances : (k, 2, 2) array
        Of `rays`.
    """

    camera: IntArray
    ball: IntArray
    rays: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.camera)


def triangle_frame(points: FloatArray) -> FloatArray:
    """Pose `(4, 4)` of the frame that the first three points `(b, 3)` span: x towards the second, origin their mean."""
    origin = points[:3].mean(axis=0)
    x = points[1] - origin
    z = np.cross(points[1] - points[0], points[2] - points[0])
    length = np.linalg.norm(z)
    if length <= THIN * float(((points[:3] - origin) ** 2).sum()):
        raise DegenerateError("three balls lie on a line, which determines no pose.")
    x, z = x / np.linalg.norm(x), z / length
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), origin)


def pose_nelder_mead(points: FloatArray, places: FloatArray) -> PoseFit:
    """Pose that minimises the sum of the distances between balls and where they should be (Peng et al. 2020, Eq. 7).

    Nelder-Mead, as in the paper, from its initial guess: the frame that the three balls span as they are.

    Parameters
    ----------
    points : (b, 3) array
        Centres of the balls, tracker frame, m; at least three.
    places : (b, 3) array
        The same in the tool frame.
    """
    points, places = _checked(points, places)
    start = se3.compose(triangle_frame(points), se3.invert(triangle_frame(places)))
    reach = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())

    def cost(x: FloatArray) -> float:
        T = _moved(start, x, reach)
        return float(np.linalg.norm(places @ T[:3, :3].T + T[:3, 3] - points, axis=1).sum() / reach)

    simplex = np.vstack([np.zeros(6), 0.02 * np.eye(6)])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-10, "maxiter": 4000, "maxfev": 4000}
    best: Any = minimize(cost, np.zeros(6), method="Nelder-Mead", options=options)
    T = _moved(start, best.x, reach)
    return PoseFit(T, _point_covariance(T, places, points), points - places @ T[:3, :3].T - T[:3, 3])


def _moved(start: FloatArray, x: FloatArray, reach: float) -> FloatArray:
    """Pose turned about its own origin, by numbers that all mean a share of the tool's size."""
    T = np.array(start)
    T[:3, :3] = se3.matrix_from_rotvec(x[3:]) @ start[:3, :3]
    T[:3, 3] = start[:3, 3] + reach * x[:3]
    return T


def pose_closed_form(points: FloatArray, places: FloatArray, weights: FloatArray | None = None) -> PoseFit:
    """Pose with the least sum of squared distances (Arun, Umeyama): the closed form beside the paper's cost.

    Parameters
    ----------
    points, places : (b, 3) arrays
        As :func:`pose_nelder_mead`.
    weights : (b,) array, optional
        Of the balls: one over the variance of each; equal when absent.
    """
    points, places = _checked(points, places)
    w = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    mean_points, mean_places = w @ points, w @ places
    A = (points - mean_points).T @ (w[:, None] * (places - mean_places))
    R = se3.nearest_rotation(A)
    T = se3.pose(R, mean_points - R @ mean_places)
    return PoseFit(T, _point_covariance(T, places, points), points - places @ R.T - T[:3, 3])


def _checked(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    points, places = np.asarray(points, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if points.shape != places.shape or points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 3:
        raise DataError(f"a pose needs three balls or more, seen and known; got {points.shape} and {places.shape}.")
    if not np.isfinite(points).all():
        raise DataError("a ball's place is missing (NaN): no pose follows from it.")
    triangle_frame(points)
    return points, places


def _point_covariance(T: FloatArray, places: FloatArray, points: FloatArray) -> FloatArray:
    """Covariance of position and rotation vector, from what the fit leaves of the distances."""
    arms = places @ T[:3, :3].T
    left = points - arms - T[:3, 3]
    variance = float((left**2).sum()) / max(3 * len(points) - 6, 1)
    J = np.concatenate([np.concatenate([np.eye(3), -_hat(arm)], axis=1) for arm in arms])
    covariance: FloatArray = variance * np.linalg.inv(J.T @ J)
    return covariance


def pose_from_sightings(
    cameras: Sequence[Camera], places: FloatArray, sightings: Sightings, start: FloatArray
) -> PoseFit:
    """Pose that reprojects best over all sightings of all balls, each weighted by its own covariance.

    A ball that only one camera sees counts too, which a ball-by-ball solution must leave out.

    Parameters
    ----------
    cameras : sequence of Camera
        All cameras.
    places : (b, 3) array
        Balls in the tool frame, m.
    sightings : Sightings
        What was seen.
    start : (4, 4) array
        A pose nearby: the closed form's, or a prediction.

    Raises
    ------
    DegenerateError
        The sightings do not determine the pose.
    """
    stack = np.stack([camera.T_camera_tracker for camera in cameras])[sightings.camera]
    focal = np.array([camera.intrinsics.focal for camera in cameras])[sightings.camera]
    weights = np.linalg.inv(sightings.covariances)
    arms_of = places[sightings.ball]
    T = np.array(start)
    for _ in range(STEPS):
        residual, J = _linearised(stack, T, arms_of, sightings.rays)
        JW = np.einsum("kij,kil->kjl", J, weights)
        information = np.einsum("kjl,klm->jm", JW, J)
        if np.linalg.cond(information) > 1e14:
            raise DegenerateError(f"{len(sightings)} sightings do not determine the tool's pose.")
        step = np.linalg.solve(information, np.einsum("kjl,kl->j", JW, residual))
        T[:3, :3] = se3.matrix_from_rotvec(step[3:]) @ T[:3, :3]
        T[:3, 3] += step[:3]
        if float(np.abs(step).max()) < SETTLED:
            break
    residual, _ = _linearised(stack, T, arms_of, sightings.rays)
    return PoseFit(T, np.linalg.inv(information), residual * focal[:, None])


def _linearised(
    stack: FloatArray, T: FloatArray, places: FloatArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residuals `(k, 2)` and Jacobians `(k, 2, 6)` for a shift and a turn of the tool, tracker axes."""
    arms = places @ T[:3, :3].T
    local = np.einsum("kij,kj->ki", stack[:, :3, :3], arms + T[:3, 3]) + stack[:, :3, 3]
    z = np.maximum(local[:, 2], 1e-9)[:, None]
    projected = local[:, :2] / z
    to_point = (stack[:, :2, :3] - projected[:, :, None] * stack[:, 2:3, :3]) / z[:, :, None]
    # A turn w moves a ball by w x arm, so the row of the projection g gives g . (w x arm) = (arm x g) . w.
    to_turn = np.cross(arms[:, None, :], to_point)
    return rays - projected, np.concatenate([to_point, to_turn], axis=2)


def _hat(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
