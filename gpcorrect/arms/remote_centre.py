"""An arm that pivots about a remote centre of motion, and its closed-form inverse kinematics.

Such an arm (RRP RRR) swings and slides a straight shaft through a fixed point, the remote centre; at the shaft's end
sit roll, pitch and yaw, the yaw axis a small distance beyond the pitch axis. The inverse is geometric, from the arm's
screw axes at joint zero, so it holds for any Denavit-Hartenberg convention:

1. the pitch axis crosses the shaft in the wrist point, which lies at the known distance from the yaw axis, in the plane
   that holds the remote centre and the yaw axis: two choices;
2. wrist point and remote centre give the shaft's line; the shaft may point either way along it: two choices;
3. two intersecting axes turn the shaft to that direction (Paden-Kahan subproblem 2; Murray, Li and Sastry 1994,
   Sec. 3.3): two choices;
4. roll, pitch and yaw follow one by one (subproblem 1).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.arms.arm import Arm
from gpcorrect.arms.chain import LIMIT_ROUNDING, Chain
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

SIGNS = np.array(np.meshgrid([1.0, -1.0], [1.0, -1.0], [1.0, -1.0], indexing="ij")).reshape(3, 8)
GEOMETRY_TOLERANCE = 1e-9  # m, or of a unit vector: far above what rounding leaves of axes that meet
SINGULAR_DISTANCE = 1e-9  # m; nearer to the remote centre than this a direction is undefined
BESIDE = np.array([3e-9, 5e-9, 7e-9])  # m; off the remote centre in no direction of an axis, and far below any sensor
ROUNDING = 1e-12  # of a square that is zero at the edge of reach: some thousand times float64's


@dataclass(frozen=True, eq=False)
class _RcmInverse:
    """Inverse of one arm: its screw axes at joint zero and what follows from them."""

    axes: FloatArray  # (6, 3) unit directions of the joint axes at joint zero, base frame
    centre: FloatArray  # (3,) the remote centre, m
    # (3,) where the pitch axis crosses the shaft, and the foot of its perpendicular on the yaw axis, m
    wrist: FloatArray
    yaw_point: FloatArray
    T_zero: FloatArray  # (4, 4) tip pose at joint zero

    @classmethod
    def of(cls, chain: Chain, wrist_link: int) -> _RcmInverse:
        """Read the geometry off a chain whose frame of link `wrist_link` (from 1) sits in the wrist point."""
        if chain.joint_types != "RRPRRR":
            raise DataError(f"the remote-centre solution is for RRPRRR arms, got {chain.joint_types}.")
        rest = np.zeros(chain.dof)
        axes, points = chain.axes(rest)
        wrist = chain.frames(rest)[wrist_link - 1, :3, 3]
        yaw_point = points[5] + axes[5] * ((wrist - points[5]) @ axes[5])
        across = np.eye(3) - axes[:2, :, None] * axes[:2, None, :]  # the centre is the point nearest to axes 1 and 2
        centre = np.linalg.solve(across.sum(axis=0), (across @ points[:2, :, None]).sum(axis=0)[:, 0])
        inverse = cls(axes, centre, wrist, yaw_point, chain.forward(rest))
        inverse._check(points)
        return inverse

    def _check(self, points: FloatArray) -> None:
        w = self.axes
        arm = self.yaw_point - self.wrist
        misses = {
            "axes 1 and 2 meet": _distance(self.centre, points[:2], w[:2]).max(),
            "the shaft passes the remote centre": _distance(self.centre, self.wrist[None], w[2:3]).max(),
            "roll is about the shaft": _distance(self.wrist, points[3:4], w[3:4]).max() + 1 - abs(w[2] @ w[3]),
            "pitch crosses the shaft": _distance(self.wrist, points[4:5], w[4:5]).max() + abs(w[3] @ w[4]),
            "pitch, yaw and their common normal are perpendicular": abs(w[4] @ w[5]) + abs(w[4] @ arm),
        }
        broken = [law for law, miss in misses.items() if miss > GEOMETRY_TOLERANCE]
        if broken or not np.linalg.norm(arm) > SINGULAR_DISTANCE:
            raise DataError(f"the chain is no remote-centre arm with a wrist offset; broken: {broken or 'offset'}.")

    def solve(self, T: FloatArray) -> FloatArray:
        """All joint values (..., 8, 6) that reach tip poses `T` (..., 4, 4), angles in -pi..pi.

        A branch that does not exist is NaN. Where the wrist point or the yaw axis passes through the remote centre,
        solutions are not isolated: those of a pose some nanometres beside it are given.
        """
        target = np.asarray(T, dtype=np.float64)
        q = self._solve(target)
        none = np.isnan(q).all(axis=(-1, -2))
        if none.any():
            beside = target[none].copy()
            beside[:, :3, 3] += BESIDE
            q[none] = self._solve(beside)
        return q

    def _solve(self, T: FloatArray) -> FloatArray:
        target = T[..., None, :, :]
        motion = target @ se3.invert(self.T_zero)  # product of the six joints' screw motions
        yaw_axis = motion[..., :3, :3] @ self.axes[5]
        arm, wrist = self._wrist(motion, yaw_axis)
        q123, R_base_shaft = self._shaft(wrist)
        q456 = self._orientation(motion[..., :3, :3], R_base_shaft, arm, yaw_axis)
        q = np.concatenate([q123, q456], axis=-1)
        return np.where(np.isfinite(q).all(axis=-1, keepdims=True), q, np.nan)

    def _wrist(self, motion: FloatArray, yaw_axis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Directions from wrist to yaw axis and wrist points, (..., 8, 3) each."""
        yaw_point = motion[..., :3, :3] @ self.yaw_point + motion[..., :3, 3]
        to_centre = self.centre - yaw_point
        across = to_centre - yaw_axis * _dot(to_centre, yaw_axis)
        arm = SIGNS[0][:, None] * _unit(across)
        return arm, yaw_point - arm * np.linalg.norm(self.yaw_point - self.wrist)

    def _shaft(self, wrist: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Joints 1 to 3 (..., 8, 3), and the rotation that the first two make (..., 8, 3, 3)."""
        w1, w2, w3 = self.axes[:3]
        away = wrist - self.centre
        direction = SIGNS[1][:, None] * _unit(away)
        depth = _dot(away, direction)[..., 0] - (self.wrist - self.centre) @ w3
        half_way = _half_way(w1, w2, w3, direction, SIGNS[2])
        q1, q2 = _turn(w1, half_way, direction), _turn(w2, w3, half_way)
        return np.stack([q1, q2, depth], axis=-1), _rotation(w1, q1) @ _rotation(w2, q2)

    def _orientation(
        self, R_motion: FloatArray, R_base_shaft: FloatArray, arm: FloatArray, yaw_axis: FloatArray
    ) -> FloatArray:
        """Roll, pitch and yaw (..., 8, 3)."""
        w4, w5, w6 = self.axes[3:]
        arm_zero = _unit(self.yaw_point - self.wrist)
        handed = np.sign(np.cross(arm_zero, w6) @ w5)
        pitch_axis = handed * np.cross(arm, yaw_axis)
        R = R_base_shaft
        roll = _turn(w4, w5, _into(R, pitch_axis))
        R = R @ _rotation(w4, roll)
        pitch = _turn(w5, arm_zero, _into(R, arm))
        R = R @ _rotation(w5, pitch)
        yaw = _turn(w6, w5, _into(R, R_motion @ w5))
        return np.stack([roll, pitch, yaw], axis=-1)


def _half_way(w1: FloatArray, w2: FloatArray, start: FloatArray, end: FloatArray, sign: FloatArray) -> FloatArray:
    """Directions (..., 8, 3) that axis 2 turns `start` into and axis 1 turns into `end`; NaN out of reach."""
    c12, s2, e1 = w1 @ w2, w2 @ start, _dot(end, w1)
    a = (c12 * s2 - e1) / (c12**2 - 1)
    b = (c12 * e1 - s2) / (c12**2 - 1)
    normal = np.cross(w1, w2)
    square = (1 - a**2 - b**2 - 2 * a * b * c12) / (normal @ normal)
    square = np.where(square > -ROUNDING, np.maximum(square, 0.0), np.nan)
    return a * w1 + b * w2 + sign[:, None] * np.sqrt(square) * normal


def _turn(axis: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Angle (...) about `axis` (3,) that turns `start` to `end` (..., 3): Paden-Kahan subproblem 1."""
    start = np.broadcast_to(start, end.shape)
    sine = np.cross(start, end) @ axis
    cosine = _dot(start, end)[..., 0] - (start @ axis) * (end @ axis)
    return np.asarray(np.arctan2(sine, cosine))


def _rotation(axis: FloatArray, angle: FloatArray) -> FloatArray:
    return se3.matrix_from_rotvec(angle[..., None] * axis)


def _into(R: FloatArray, vector: FloatArray) -> FloatArray:
    """R^T v, row by row."""
    return (np.swapaxes(R, -1, -2) @ vector[..., None])[..., 0]


def _dot(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray((u * v).sum(axis=-1, keepdims=True))


def _unit(v: FloatArray) -> FloatArray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    defined = length > SINGULAR_DISTANCE
    return np.where(defined, v / np.where(defined, length, 1.0), np.nan)


def _distance(point: FloatArray, on_lines: FloatArray, directions: FloatArray) -> FloatArray:
    """Distances (k,) of a point from k lines."""
    return np.asarray(np.linalg.norm(np.cross(on_lines - point, directions), axis=-1))


@dataclass(frozen=True, eq=False)
class Solutions:
    """Closed-form inverse kinematics of one or many poses.

    Parameters
    ----------
    q : (..., 8, dof) array
        Joint values by branch, NaN where the branch does not exist; each angle is the turn nearest to the
        middle of its limits.
    exists : (..., 8) bool array, whether the branch reaches the pose
    within_limits : (..., 8) bool array, whether it also keeps every joint limit
    """

    q: FloatArray
    exists: BoolArray
    within_limits: BoolArray


@dataclass(frozen=True, eq=False, kw_only=True)
class RemoteCentreArm(Arm):
    """A surgical arm, RRPRRR, that pivots about a remote centre of motion.

    Parameters
    ----------
    wrist_link : int, link (from 1) whose frame sits in the wrist point, where the pitch axis crosses the shaft

    Raises
    ------
    DataError
        The chain's axes do not meet in a remote centre, or an array does not fit the chain.
    """

    wrist_link: int
    _inverse: _RcmInverse = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "_inverse", _RcmInverse.of(self.chain, self.wrist_link))

    def wrist(self, q: ArrayLike) -> FloatArray:
        """Return the wrist points (..., 3), m; the first three joints alone move them.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        return self.chain.frames(q)[..., self.wrist_link - 1, :3, 3]

    def solutions(self, T: ArrayLike) -> Solutions:
        """Return all closed-form solutions for tip poses, in and out of limits.

        Parameters
        ----------
        T : (..., 4, 4) array, tip poses in the base frame
        """
        poses = np.asarray(T, dtype=np.float64)
        if poses.shape[-2:] != (4, 4):
            raise DataError(f"poses must have shape (..., 4, 4), got {poses.shape}.")
        q = self._inverse.solve(poses)
        turns = np.round((self.limits.mean(axis=1) - q) / (2 * np.pi))  # full ones, to the middle of the limits
        q = q + np.where(self.chain.revolute, 2 * np.pi * turns, 0.0)
        exists: BoolArray = np.asarray(np.isfinite(q).all(axis=-1))
        return Solutions(q, exists, exists & self.chain.within_limits(q, LIMIT_ROUNDING))

    def inverse(self, T: ArrayLike, within_limits: bool = True) -> FloatArray:
        """Joint values (k, dof) that reach one tip pose `T` (4, 4); k is 0 when there are none.

        Parameters
        ----------
        T : (4, 4) array, tip pose in the base frame
        within_limits : bool
            Return the solutions that keep every limit, with all full turns that do; otherwise every solution once.
        """
        pose = np.asarray(T, dtype=np.float64)
        if pose.shape != (4, 4):
            raise DataError(f"one pose (4, 4) is expected, got {pose.shape}; see solutions() for many.")
        found = self.solutions(pose)
        q = found.q[found.exists]
        return self._all_turns(q) if within_limits else q

    def follow(self, T: ArrayLike, start: ArrayLike | None = None) -> FloatArray:
        """See :class:`Arm`: always the nearest solution, in parts of each joint's range."""
        found = self.solutions(T)
        near = self.home if start is None else self.chain.joint_values(start)
        path, spans = np.empty((len(found.q), self.dof)), np.ptp(self.limits, axis=1)
        for i, branches in enumerate(found.q):
            options = self._all_turns(branches[found.exists[i]])
            if not len(options):
                hint = "Move the path into the workspace."
                raise DataError(f"pose {i} cannot be reached within the limits of {self.name}.", hint=hint)
            near = path[i] = options[np.argmin((((options - near) / spans) ** 2).sum(axis=1))]
        return path

    def _all_turns(self, q: FloatArray) -> FloatArray:
        """Every variant of `q` (k, dof) by one full turn of a revolute joint that keeps the limits."""
        roomy = self.chain.revolute & (np.ptp(self.limits, axis=1) > 2 * np.pi)
        choices = [(-1, 0, 1) if room else (0,) for room in roomy]
        shifts = 2 * np.pi * np.array(list(product(*choices)))
        variants = (q[:, None] + shifts).reshape(-1, self.dof)
        return variants[self.chain.within_limits(variants, LIMIT_ROUNDING)]
