"""Points from rays, and the tool's pose from its balls: the paper's estimates, closed form, least squares on pixels."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera

LEAST_ANGLE = np.deg2rad(1.0)  # between two rays: one pixel of error is then a tenth of the distance in depth
USUAL_NOISE_PX = 0.1  # of a centre without a covariance: what this package's outlines have
STEPS, CONVERGED = 10, 1e-9  # steps of Gauss-Newton, which takes three or four, and its last step (m and rad)
LEAST_DEPTH = 1e-9  # m: keeps the projection of a point behind a camera finite
POSE = 6  # numbers of a pose: position, rotation vector
FIXED_TURN = 1e-6  # rad^2: variance of a turn that nothing shows: of one ball, and of two about their line
THIN = 1e-3  # of the second over the first singular value of the balls' places: below, they are on a line
WORST_CONDITION = 1e14  # of an information matrix in m and rad: beyond it, rounding decides


@dataclass(frozen=True, eq=False)
class Located:
    """A point in space."""

    position: FloatArray  # (3,) tracker frame, m
    covariance: FloatArray  # (3, 3) m^2
    residuals: FloatArray  # (k, 2) seen minus reprojected, px, one row a camera


def common_perpendicular(
    origin_a: FloatArray, direction_a: FloatArray, origin_b: FloatArray, direction_b: FloatArray
) -> tuple[FloatArray, float]:
    """Return the midpoint of the common perpendicular of two rays and its length, m.

    DegenerateError where they are nearly parallel.

    Parameters
    ----------
    origin_a, direction_a, origin_b, direction_b : (3,) arrays, of the rays, m; directions of any length
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

    DegenerateError where no pair crosses.

    Parameters
    ----------
    origins, directions : (k, 3) arrays, of the rays, tracker frame, m; pairs that are nearly parallel are left out
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


@dataclass(frozen=True, eq=False)
class Observations:
    """Balls as cameras see them, a row each time that a camera sees a ball.

    Parameters
    ----------
    camera, ball : (k,) int arrays, which camera sees which ball
    rays : (k, 2) array, undistorted places on the plane one unit before the lens
    covariances : (k, 2, 2) array, of `rays`
    delays : (k,) array, optional, when each was seen, after the frame's own time, s; zeros when absent
    """

    camera: IntArray
    ball: IntArray
    rays: FloatArray
    covariances: FloatArray
    delays: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """How the tool moves, as far as that is known before a frame."""

    twist: FloatArray  # (6,) velocity (m/s) and angular velocity (rad/s), tracker axes
    covariance: FloatArray  # (6, 6) of `twist`


@dataclass(frozen=True, eq=False)
class Linearised:
    """The last step of a least-squares fit: what an error of a view, a clock or a camera does to the pose."""

    J: FloatArray  # (k, 2, n) of the projections, in the pose and, where views have delays, the velocity
    weights: FloatArray  # (k, 2, 2) inverse covariances of the views
    information: FloatArray  # (n, n)
    residual: FloatArray  # (k, 2) seen minus projected, on the plane one unit before the lens
    twist: FloatArray  # (6,) velocity of the tool, as solved for
    free: int  # six numbers of a pose, or three of a position

    @property
    def velocity(self) -> FloatArray:
        """How fast each view moves `(k, 2)`, on the plane one unit before the lens, 1/s."""
        return np.asarray(self.J[:, :, : self.free] @ self.twist[: self.free])

    @property
    def chi_squared(self) -> float:
        """Squared residuals over their variances, a degree of freedom: 1 where the covariances are right."""
        total = float(np.einsum("ki,kij,kj->", self.residual, self.weights, self.residual))
        return total / max(self.residual.size - self.free, 1)

    @property
    def scatter(self) -> float:
        """How far errors of single views may put a position off, m: a standard deviation, no view better than it is."""
        variance = float(np.trace(np.linalg.inv(self.information)[:3, :3])) * max(self.chi_squared, 1.0)
        return float(np.sqrt(variance))

    def projected(self, effects: FloatArray) -> FloatArray:
        """Return the normal equations' right side `(n, m)` of what m errors do to the views.

        Parameters
        ----------
        effects : (k, 2, m) array, on the plane one unit before the lens
        """
        return np.asarray(np.einsum("kij,kil,klm->jm", self.J, self.weights, effects))

    def gain(self, effects: FloatArray) -> FloatArray:
        """Return by how much m errors of views move the pose `(6, m)`.

        Parameters
        ----------
        effects : (k, 2, m) array
        """
        moved = np.zeros((POSE, effects.shape[2]))
        moved[: self.free] = np.linalg.solve(self.information, self.projected(effects))[: self.free]
        return moved

    def shifted(self, cameras: IntArray, excess: float, least: float) -> FloatArray:
        """Return the covariance `(6, 6)` of a pose whose cameras' pictures are each shifted as a whole.

        Views of one camera then err together, and no number of balls averages that out.

        Parameters
        ----------
        cameras : (k,) int array, of the views
        excess : float, by how much :attr:`chi_squared` is above what is expected: the shifts that leave it are taken
        least : float, variance of a shift's coordinate, on the plane one unit before the lens, that it has at least
        """
        effects = np.zeros((len(cameras), 2, 2 * (int(cameras.max()) + 1)))
        for axis in (0, 1):
            effects[np.arange(len(cameras)), axis, 2 * cameras + axis] = 1.0
        right = self.projected(effects)
        seen = float(np.trace(self.weights, axis1=1, axis2=2).sum())  # of shifts, less what moves the pose instead
        seen -= float(np.einsum("nm,nm->", right, np.linalg.solve(self.information, right)))
        variance = max(excess, 0.0) * max(self.residual.size - self.free, 1) / seen if seen > 0 else 0.0
        gain = self.gain(effects)
        return np.asarray(max(variance, least) * gain @ gain.T)


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose of the tool."""

    T_tracker_tool: FloatArray  # (4, 4) m
    covariance: FloatArray  # (6, 6) position (m), then rotation vector (rad), tracker axes
    # (k, 2) or (b, 3) seen minus reprojected in px for observations; observed minus fitted ball centres in m otherwise
    residuals: FloatArray
    linearised: Linearised | None = None  # of a fit to observations

    @property
    def rms(self) -> float:
        """RMS length of the residuals, px or m."""
        return float(np.sqrt(np.mean((self.residuals**2).sum(axis=1))))


def pose_closed_form(points: FloatArray, places: FloatArray) -> PoseFit:
    """Pose with the least sum of squared distances (Arun et al. 1987).

    Parameters
    ----------
    points : (b, 3) array, centres of the balls, tracker frame, m; at least three
    places : (b, 3) array, the same in the tool frame

    Raises
    ------
    DataError
        A ball is missing; :class:`DegenerateError` when they lie on a line.
    """
    points, places = np.asarray(points, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if points.shape != places.shape or points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 3:
        raise DataError(f"a pose needs three balls or more, seen and known; got {points.shape} and {places.shape}.")
    if not np.isfinite(points).all():
        raise DataError("a ball's place is missing (NaN): no pose follows from it.")
    first, second, _ = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if second <= THIN * first:
        raise DegenerateError("the balls lie on a line, which determines no pose.")
    mean_points, mean_places = points.mean(axis=0), places.mean(axis=0)
    R = se3.nearest_rotation((points - mean_points).T @ (places - mean_places))
    # The covariance is that of what the fit leaves of the distances.
    arms = places @ R.T
    T = se3.pose(R, mean_points - R @ mean_places)
    residuals = points - arms - T[:3, 3]
    variance = float((residuals**2).sum()) / max(residuals.size - 6, 1)
    turns = np.cross(arms[:, None, :], np.eye(3))  # a turn w moves a ball by w x arm
    J = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2).reshape(-1, 6)
    return PoseFit(T, variance * np.linalg.inv(J.T @ J), residuals)


def along(direction: FloatArray, place: FloatArray, R: FloatArray) -> FloatArray:
    """Return the rotation `(3, 3)` that turns `place` into a direction, and else is nearest to another rotation.

    Parameters
    ----------
    direction, place : (3,) arrays, not zero
    R : (3, 3) array
    """
    one = np.outer(direction, place) / (np.linalg.norm(direction) * np.linalg.norm(place))
    return se3.nearest_rotation(one / THIN + R)


def pose_from_observations(
    cameras: Sequence[Camera],
    places: FloatArray,
    observations: Observations,
    start: FloatArray,
    motion: Motion | None = None,
) -> PoseFit:
    """Pose that reprojects best over all observations of all balls, each weighted by its own covariance.

    A ball that only one camera sees counts too, which a ball-by-ball solution must leave out. Views with delays show
    the tool where it was by then: its velocity is solved for with the pose.

    Parameters
    ----------
    cameras : sequence of Camera
    places : (b, 3) array
        Balls in the tool frame, m. With one, the tool does not turn; with two, not about the line through them.
    observations : Observations
    start : (4, 4) array, a pose nearby: the closed form's, or a prediction
    motion : Motion, optional, what is known of the velocity; delays are left out of account without it

    Raises
    ------
    DegenerateError
        The observations do not determine the pose.
    """
    stack = np.stack([camera.T_camera_tracker for camera in cameras])[observations.camera]
    focal = np.array([camera.intrinsics.focal for camera in cameras])[observations.camera]
    weights = np.asarray(np.linalg.inv(observations.covariances), dtype=np.float64)
    free = POSE if len(places) > 1 else 3
    delays, prior = np.zeros(len(stack)), None
    if motion is not None and observations.delays is not None and observations.delays.any():
        delays, prior = observations.delays, np.linalg.inv(motion.covariance[:free, :free])
    T, twist = np.array(start), np.zeros(POSE) if motion is None else np.array(motion.twist)
    twist[free:] = 0.0
    for _ in range(STEPS):
        arms = places[observations.ball] @ T[:3, :3].T
        moved = arms + T[:3, 3] + delays[:, None] * (twist[:3] + np.cross(twist[3:], arms))
        residual, to_point = reprojection(stack, moved, observations.rays)
        # A turn w moves a ball by w x arm, so the row of the projection g gives g . (w x arm) = (arm x g) . w.
        J = np.concatenate([to_point, np.cross(arms[:, None, :], to_point)], axis=2)[:, :, :free]
        J = J if prior is None else np.concatenate([J, delays[:, None, None] * J], axis=2)
        information, right = normal_equations(residual, J, weights)
        if motion is not None and prior is not None:
            information[free:, free:] += prior
            right[free:] += prior @ (motion.twist - twist)[:free]
        if len(places) == 2:
            line = (T[:3, :3] @ (places[1] - places[0])) / np.linalg.norm(places[1] - places[0])
            information[3:POSE, 3:POSE] += np.outer(line, line) / FIXED_TURN
        if np.linalg.cond(information) > WORST_CONDITION:
            raise DegenerateError(f"{len(residual)} observations do not determine the tool's pose.")
        step = np.linalg.solve(information, right)
        twist[:free] += step[free:] if prior is not None else 0.0
        turn = step[3:POSE] if free == POSE else np.zeros(3)
        T = se3.pose(se3.matrix_from_rotvec(turn) @ T[:3, :3], T[:3, 3] + step[:3])
        if float(np.abs(step[:free]).max()) < CONVERGED:
            break
    covariance = FIXED_TURN * np.eye(POSE)
    covariance[:free, :free] = np.linalg.inv(information)[:free, :free]
    last = Linearised(J, weights, information, residual, twist, free)
    return PoseFit(T, covariance, residual * focal[:, None], last)
