"""Points from rays, and the tool's pose from its balls: the paper's estimates, and least squares on pixels."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera

__all__ = [
    "Located",
    "Observations",
    "PoseFit",
    "common_perpendicular",
    "mean_midpoint",
    "pose_closed_form",
    "pose_from_observations",
    "pose_nelder_mead",
    "triangulate",
]

LEAST_ANGLE = np.deg2rad(1.0)  # between two rays: one pixel of error is then a tenth of the distance in depth
USUAL_NOISE_PX = 0.1  # of a centre without a covariance: what this package's outlines have
STEPS, CONVERGED = 10, 1e-9  # steps of Gauss-Newton, which takes three or four, and its last step (m and rad)
THIN = 1e-3  # height of a triangle over its spread, below which three balls are on a line
WORST_CONDITION = 1e14  # of an information matrix in m and rad: beyond it, rounding decides
LEAST_DEPTH = 1e-9  # m: keeps the projection of a point behind a camera finite


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
        Seen minus reprojected in px for observations; observed minus fitted ball centres in m otherwise.
    """

    T_tracker_tool: FloatArray
    covariance: FloatArray
    residuals: FloatArray

    @property
    def rms(self) -> float:
        """RMS length of the residuals, px or m."""
        return float(np.sqrt(np.mean((self.residuals**2).sum(axis=1))))


@dataclass(frozen=True, eq=False)
class Observations:
    """Balls as cameras see them, a row each time that a camera sees a ball.

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


def common_perpendicular(
    origin_a: FloatArray, direction_a: FloatArray, origin_b: FloatArray, direction_b: FloatArray
) -> tuple[FloatArray, float]:
    """Return the midpoint of the common perpendicular of two rays, and its length.

    Parameters
    ----------
    origin_a, direction_a, origin_b, direction_b : (3,) arrays
        Of the rays, m; directions of any length.

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
    origins, directions : (k, 3) arrays
        Of the rays, tracker frame, m; pairs that are nearly parallel are left out.

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
    mean: FloatArray = np.mean(midpoints, axis=0)
    return mean


def triangulate(cameras: Sequence[Camera], rays: FloatArray, covariances: FloatArray | None = None) -> Located:
    """Return the point that reprojects best, each camera weighted by how well it sees it.

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
        covariances = (USUAL_NOISE_PX / focal)[:, None, None] ** 2 * np.eye(2)
    local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    R_tracker_camera = np.swapaxes(T[:, :3, :3], 1, 2)
    origins = -(R_tracker_camera @ T[:, :3, 3, None])[..., 0]
    point = mean_midpoint(origins, (R_tracker_camera @ local[..., None])[..., 0])
    weights = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    for _ in range(STEPS):
        residual, J = _reprojection(T, point, rays)
        information, right = _normal_equations(residual, J, weights)
        step = np.linalg.solve(information, right)
        point = point + step
        if float(np.abs(step).max()) < CONVERGED:
            break
    residual, _ = _reprojection(T, point, rays)
    return Located(point, np.linalg.inv(information), residual * focal[:, None])


def _reprojection(T: FloatArray, points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals `(k, 2)`, seen minus projected, and Jacobians `(k, 2, 3)` of projections of `points`."""
    local = np.einsum("kij,kj->ki", T[:, :3, :3], np.broadcast_to(points, (len(T), 3))) + T[:, :3, 3]
    z = np.maximum(local[:, 2], LEAST_DEPTH)[:, None]
    projected = local[:, :2] / z
    return rays - projected, (T[:, :2, :3] - projected[:, :, None] * T[:, 2:3, :3]) / z[:, :, None]


def _normal_equations(residual: FloatArray, J: FloatArray, weights: FloatArray) -> tuple[Any, Any]:
    """Information matrix and right side of a Gauss-Newton step with a weight matrix `(2, 2)` a row."""
    JW = np.einsum("kij,kil->kjl", J, weights)
    return np.einsum("kjl,klm->jm", JW, J), np.einsum("kjl,kl->j", JW, residual)


def _triangle_frame(points: FloatArray) -> FloatArray:
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

    Raises
    ------
    DataError
        A ball is missing; :class:`DegenerateError` when they lie on a line.
    """
    points, places = _checked(points, places)
    start = se3.compose(_triangle_frame(points), se3.invert(_triangle_frame(places)))
    reach = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())

    def moved(x: FloatArray) -> FloatArray:
        """Pose shifted by fractions of the tool's size, and turned about its own origin."""
        return se3.pose(se3.matrix_from_rotvec(x[3:]) @ start[:3, :3], start[:3, 3] + reach * x[:3])

    def cost(x: FloatArray) -> float:
        T = moved(x)
        return float(np.linalg.norm(places @ T[:3, :3].T + T[:3, 3] - points, axis=1).sum() / reach)

    simplex = np.vstack([np.zeros(6), 0.02 * np.eye(6)])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-10, "maxiter": 4000, "maxfev": 4000}
    best: Any = minimize(cost, np.zeros(6), method="Nelder-Mead", options=options)
    return _point_fit(moved(best.x), points, places)


def pose_closed_form(points: FloatArray, places: FloatArray) -> PoseFit:
    """Pose with the least sum of squared distances (Arun et al. 1987), the closed form beside the paper's cost.

    Parameters
    ----------
    points, places : (b, 3) arrays
        As :func:`pose_nelder_mead`.

    Raises
    ------
    DataError
        As :func:`pose_nelder_mead`.
    """
    points, places = _checked(points, places)
    mean_points, mean_places = points.mean(axis=0), places.mean(axis=0)
    R = se3.nearest_rotation((points - mean_points).T @ (places - mean_places))
    return _point_fit(se3.pose(R, mean_points - R @ mean_places), points, places)


def _checked(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    points, places = np.asarray(points, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if points.shape != places.shape or points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 3:
        raise DataError(f"a pose needs three balls or more, seen and known; got {points.shape} and {places.shape}.")
    if not np.isfinite(points).all():
        raise DataError("a ball's place is missing (NaN): no pose follows from it.")
    _triangle_frame(points)
    return points, places


def _point_fit(T: FloatArray, points: FloatArray, places: FloatArray) -> PoseFit:
    """Pose with its covariance from what the fit leaves of the distances."""
    arms = places @ T[:3, :3].T
    residuals = points - arms - T[:3, 3]
    variance = float((residuals**2).sum()) / max(residuals.size - 6, 1)
    turns = np.cross(arms[:, None, :], np.eye(3))  # a turn w moves a ball by w x arm
    J = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2).reshape(-1, 6)
    return PoseFit(T, variance * np.linalg.inv(J.T @ J), residuals)


def pose_from_observations(
    cameras: Sequence[Camera], places: FloatArray, observations: Observations, start: FloatArray
) -> PoseFit:
    """Pose that reprojects best over all observations of all balls, each weighted by its own covariance.

    A ball that only one camera sees counts too, which a ball-by-ball solution must leave out.

    Parameters
    ----------
    cameras : sequence of Camera
    places : (b, 3) array
        Balls in the tool frame, m.
    observations : Observations
        What was seen.
    start : (4, 4) array
        A pose nearby: the closed form's, or a prediction.

    Raises
    ------
    DegenerateError
        The observations do not determine the pose.
    """
    stack = np.stack([camera.T_camera_tracker for camera in cameras])[observations.camera]
    focal = np.array([camera.intrinsics.focal for camera in cameras])[observations.camera]
    weights = np.asarray(np.linalg.inv(observations.covariances), dtype=np.float64)
    T = np.array(start)
    for _ in range(STEPS):
        arms = places[observations.ball] @ T[:3, :3].T
        residual, to_point = _reprojection(stack, arms + T[:3, 3], observations.rays)
        # A turn w moves a ball by w x arm, so the row of the projection g gives g . (w x arm) = (arm x g) . w.
        J = np.concatenate([to_point, np.cross(arms[:, None, :], to_point)], axis=2)
        information, right = _normal_equations(residual, J, weights)
        if np.linalg.cond(information) > WORST_CONDITION:
            raise DegenerateError(f"{len(residual)} observations do not determine the tool's pose.")
        step = np.linalg.solve(information, right)
        T = se3.pose(se3.matrix_from_rotvec(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])
        if float(np.abs(step).max()) < CONVERGED:
            break
    points = places[observations.ball] @ T[:3, :3].T + T[:3, 3]
    residual, _ = _reprojection(stack, points, observations.rays)
    return PoseFit(T, np.linalg.inv(information), residual * focal[:, None])
