"""The kinematics of the arm that a log was recorded on: learned, turned round, and what it adds to a recording.

Its owner need not say which arm it is: a controller computes its poses from its joints, and
:func:`gpcorrect.arms.identify_chain` finds out how. Where the owner does say it, poses of joints, and true
joints of a tracker's poses, stand in for what the recording lacks.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from gpcorrect import se3
from gpcorrect.arms import Chain, identify_chain, workspace
from gpcorrect.calibration.dataset import evenly_spread
from gpcorrect.calibration.poses import rotations_of
from gpcorrect.calibration.queries import TWIST
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.rigid import register
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, PoseSignal, frozen_array

SOURCES = (("setpoint_cp", "setpoint_jp"), ("measured_cp", "measured_jp"))
"""Pairs of which one kinematics made the first from the second."""
STARTS = 300  # postures of the training that an inverse begins at: chosen by hand
GRIPPER = 2  # joints at the end of a log that may belong to a gripper: no arm here logs more
NO_EFFECT = 1e-6  # m/rad or rad/rad: a joint that moves the tip less is a gripper; chosen by hand
LEAST_SHARE = 0.01
"""Of its largest, that the arm's smallest rate must reach in most of the training: else poses do not determine joints,
and a correction in joints is as good as any other; chosen by hand."""
HEADROOM = 2.0  # by how much further from the arm's reach than in training a pose may lie; chosen by hand
NOISE_FLOOR = 1e-6  # rad: what the inverse leaves of a pose that it reaches, with plenty to spare
SAMPLES = 1000  # postures in the registration, two dozen unknowns of which need no more, and that are looked at
STEPS = 20  # Gauss-Newton steps of the registration; those of well-determined ones end after five
AT_REST = 1e-8  # rad: a step that is smaller ends the registration
FAR = 4.0
"""Median errors beyond which a sample does not count: no noise of six numbers lies there, outliers do. By hand."""
ZERO_WEIGHT = 1e-3
"""Weight of a zero (rad, m) against a sample: it decides only where the motion does not tell zeros from other moves."""


@dataclass(frozen=True, eq=False)
class ArmKinematics:
    """A learned chain, with what its inverse needs."""

    chain: Chain  # from the joints that move the tip to its poses, as the robot's controller has it
    starts: FloatArray  # (k, d) postures of the training, rad and m
    length: float  # m that weigh as much as one radian
    # how far from any posture's pose a desired one may lie, rad (and m over `length`): an arm of fewer than six joints
    # comes only near most poses
    reach: float = np.inf
    _nearest: cKDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "starts", frozen_array(self.starts))
        fits = self.starts.ndim == 2 and self.starts.shape[1] == self.chain.dof and len(self.starts) > 0
        if not (fits and np.isfinite(self.starts).all() and 0 < self.length < np.inf and not np.isnan(self.reach)):
            raise DataError(f"kinematics of {self.chain.dof} joints do not fit together: starts {self.starts.shape}.")
        if not np.isfinite(self.chain.forward(self.starts)).all():
            raise DataError("the chain of the model's kinematics is not finite.")
        object.__setattr__(self, "_nearest", cKDTree(self._coordinates(self.chain.forward(self.starts))))

    @classmethod
    def of(cls, log: CalibrationLog) -> Self:
        """Return the kinematics of a log's commanded, else of its reported joints and poses.

        Parameters
        ----------
        log : CalibrationLog, n samples

        Raises
        ------
        LogError
            The log holds no joints, or no orientations.
        DataError, DegenerateError
            No chain makes its poses of its joints, or its motion does not show one, or poses do not determine joints.
        """
        for pose_name, joint_name in SOURCES:
            poses, joints = getattr(log, pose_name), getattr(log, joint_name)
            if poses is not None and joints is not None and poses.quaternion is not None:
                break
        else:
            raise LogError("it does not hold poses with orientation and the joints they were computed from.")
        rows = np.flatnonzero(poses.finite & np.isfinite(joints).all(axis=1))
        T, q = _pose_matrices(poses[rows]), joints[rows]
        likely, turning = log.joint_types(q.shape[1]), "R" * q.shape[1]
        chain = _chain_of(q, T, (likely,) if log.meta.joint_types or likely == turning else (likely, turning))
        q, length = q[:, : chain.dof], workspace(T)
        _require_determined(chain, q[evenly_spread(len(q), SAMPLES)], length)
        kinematics = cls(chain, q[evenly_spread(len(q), STARTS)], length)
        _, left = kinematics.chain.nearest(T, q, length)
        return replace(kinematics, reach=float(left.max()))

    def reaching(self, poses: PoseSignal) -> tuple[Self, FloatArray]:
        """Return the kinematics that takes poses as far from its reach as these are, with headroom, and their joints.

        Parameters
        ----------
        poses : PoseSignal, n poses in the command's frame
        """
        q, left = self._inverse(poses)
        return replace(self, reach=HEADROOM * max(self.reach, float(np.nanmax(left, initial=0.0))) + NOISE_FLOOR), q

    def inverse(self, poses: PoseSignal) -> FloatArray:
        """Return the joints `(n, d)` nearest to poses; NaN where the arm comes not near.

        Parameters
        ----------
        poses : PoseSignal, n poses in the command's frame, with orientation
        """
        q, left = self._inverse(poses)
        q[~(left <= self.reach)] = np.nan
        return q

    def inverse_one(self, position: FloatArray, rotation: FloatArray, near: FloatArray | None) -> FloatArray:
        """Return the joints `(d,)` nearest to one pose, NaN where the arm comes not near: the hot path of streams.

        Parameters
        ----------
        position, rotation : (3,) and (3, 3) arrays, the pose, command's frame
        near : (d,) array or None, where to begin; at the training's nearest posture without it
        """
        T = np.eye(4)[None]
        T[0, :3, :3], T[0, :3, 3] = rotation, position
        start = self.starts[self._nearest.query(self._coordinates(T))[1]] if near is None else near[None]
        q, left = self.chain.nearest(T, start, self.length)
        return q[0] if left[0] <= self.reach else np.full(len(q[0]), np.nan)

    def determined(self, q: FloatArray) -> BoolArray:
        """Return at which postures poses say where the joints are `(n,)`: not where two axes of a wrist fall together.

        There, noise and small errors of a pose are large ones of joints, and a law of all samples would be theirs.

        Parameters
        ----------
        q : (n, d) array, rad or m; False where one is missing
        """
        share = np.zeros(len(q))
        known = np.isfinite(q).all(axis=1)
        share[known] = _least_share(self.chain, q[known], self.length)
        return np.asarray(share >= LEAST_SHARE)

    def carried(self, poses: PoseSignal, q: FloatArray, corrected: FloatArray) -> PoseSignal:
        """Return poses moved as the tip moves from joints to others; where the arm reaches them, onto its poses.

        Parameters
        ----------
        poses : PoseSignal, n poses, complete
        q, corrected : (n, d) arrays, joints of the poses, and those that the arm moves to, rad and m
        """
        before, after, turned = self.chain.forward(q), self.chain.forward(corrected), rotations_of(poses)
        assert turned is not None
        R = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], -1, -2) @ turned
        return PoseSignal(poses.position + after[:, :3, 3] - before[:, :3, 3], se3.quaternion_from_matrix(R))

    def _inverse(self, poses: PoseSignal) -> tuple[FloatArray, FloatArray]:
        q, left, known = np.full((len(poses), self.chain.dof), np.nan), np.full(len(poses), np.nan), poses.finite
        T = _pose_matrices(poses[known])
        start = self.starts[self._nearest.query(self._coordinates(T))[1]]
        q[known], left[known] = self.chain.nearest(T, start, self.length)
        return q, left

    def _coordinates(self, T: FloatArray) -> FloatArray:
        """Poses `(n, 4, 4)` as points `(n, 12)` between which distances are about those of poses."""
        return np.hstack([T[:, :3, 3] / self.length, T[:, :3, :3].reshape(-1, 9) / np.sqrt(2)])


def _chain_of(q: FloatArray, T: FloatArray, kinds: Sequence[str]) -> Chain:
    """Return the chain of the joints that move the tip: all of them, or without a gripper's, which come last.

    Of the first of some kinds of joints that makes the poses.
    """
    failed: DataError | None = None
    dof = q.shape[1]
    for types, count in itertools.product(kinds, range(dof, max(dof - 1 - GRIPPER, 0), -1)):
        try:
            chain = identify_chain(q[:, :count], T, types[:count])
        except DataError as error:
            failed = failed or error
            continue
        if (np.abs(chain.jacobian(q[evenly_spread(len(q), SAMPLES)][:, :count])).max(axis=(0, 1)) > NO_EFFECT).all():
            return chain
    raise failed or DegenerateError("no joint of the log moves the tip.")


def _require_determined(chain: Chain, q: FloatArray, length: float) -> None:
    """Refuse an arm whose poses do not say where its joints are."""
    if chain.dof > TWIST or np.median(_least_share(chain, q, length)) < LEAST_SHARE:
        raise DegenerateError(f"poses do not determine the {chain.dof} joints that move the tip.")


def _least_share(chain: Chain, q: FloatArray, length: float) -> FloatArray:
    """Return of postures `(n, d)` the arm's smallest rate over its largest `(n,)`: 0 where poses leave a joint open."""
    rates = np.linalg.svd(chain.jacobian(q) / np.array([length] * 3 + [1.0] * 3)[:, None], compute_uv=False)
    return np.asarray(rates[:, -1] / rates[:, 0])


def _pose_matrices(poses: PoseSignal) -> FloatArray:
    """Return poses with orientation as matrices `(n, 4, 4)`."""
    if poses.quaternion is None:
        hint = "Log orientations too, or leave `joints` out of --features."
        raise DataError("joints are computed from whole poses, and these have no orientation.", hint=hint)
    return se3.from_parts(poses.position, poses.quaternion)


def with_poses(log: CalibrationLog, chain: Chain) -> CalibrationLog:
    """Return a log with the poses that its joints stand for, where it has none: of its commands, and as reported.

    Parameters
    ----------
    log : CalibrationLog, n samples; joints behind the chain's, such as a gripper's, are not looked at
    chain : Chain, the arm's

    Raises
    ------
    LogError
        The log has fewer joints than the chain, or joints of other kinds.
    """
    found: dict[str, Any] = {}
    for pose_name, joint_name in SOURCES:
        joints = getattr(log, joint_name)
        if getattr(log, pose_name) is None and joints is not None:
            T = chain.forward(_of_chain(log, joints, chain))
            found[pose_name] = PoseSignal(*se3.to_parts(T))
    return replace(log, **found) if found else log


def with_outside_joints(log: CalibrationLog, chain: Chain) -> CalibrationLog:
    """Return a log with the true joints that its tracker's poses stand for, where nothing outside saw the joints.

    Base and marker are registered to the poses of the log's own joints, together with the zeros of these (Hollerbach
    and Wampler 1996); the true joints are those near to the log's that reach the tracker's poses.

    Parameters
    ----------
    log : CalibrationLog
        n samples; one with outside joints, or without joints or a tracker, is returned as it is. Joints behind the
        chain's, such as a gripper's, are left out.
    chain : Chain, the arm's

    Raises
    ------
    LogError
        The log's joints are not the chain's, or the tracker has no orientations.
    DegenerateError
        Poses do not determine the joints, or the motion does not determine the registration.
    """
    tracker, reported = log.tracker_cp, log.setpoint_jp if log.measured_jp is None else log.measured_jp
    if log.external_jp is not None or tracker is None or reported is None:
        return log
    if tracker.quaternion is None:
        raise LogError("joints are computed from poses, and tracker_cp has no orientations.", path=log.name)
    q = _of_chain(log, reported, chain)
    rows = np.flatnonzero(tracker.finite & np.isfinite(q).all(axis=1))
    if not len(rows):
        raise LogError("no row has all joints and a pose of the tracker.", path=log.name)
    T = chain.forward(q[rows])
    length = workspace(T)
    _require_determined(chain, q[rows], length)
    rigid = register(tracker[rows], PoseSignal(*se3.to_parts(T)), log.trajectory[rows], "auto", held_out=False).model
    base, marker = se3.pose(rigid.R_position, rigid.t), se3.pose(rigid.R_right, rigid.offset)
    seen = _pose_matrices(tracker[rows])
    few = evenly_spread(len(rows), SAMPLES)
    base, marker = _with_zeros(chain, q[rows][few], seen[few], length, (base, marker))
    external = np.full_like(q, np.nan)
    external[rows] = chain.nearest(base @ seen @ marker, q[rows], length)[0]
    own = {name: values[:, : chain.dof] for name in log.JOINTS if (values := getattr(log, name)) is not None}
    types = log.meta.joint_types[: chain.dof] or chain.joint_types
    return replace(log, **own | {"external_jp": external}, meta=replace(log.meta, joint_types=types))


def _with_zeros(
    chain: Chain, q: FloatArray, seen: FloatArray, length: float, start: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return base and marker `(4, 4)`, so that base @ seen @ marker are the tip's poses, up to zeros of the joints.

    The first joint's zero could be a turn of the base as well, and the last one's a turn of the marker: both stay 0.
    """
    base, marker = start
    zeros, inner = np.zeros(chain.dof), np.arange(1, chain.dof - 1)
    ridge = np.hstack([np.zeros((inner.size, 12)), np.eye(inner.size) * ZERO_WEIGHT * np.sqrt(len(q))])
    scale = np.array([length] * 3 + [1.0] * 3)
    for _ in range(STEPS):
        found, tip = base @ seen @ marker, chain.forward(q + zeros)
        turned = se3.rotvec_from_matrix(found[:, :3, :3] @ np.swapaxes(tip[:, :3, :3], 1, 2))
        error = np.hstack([found[:, :3, 3] - tip[:, :3, 3], turned]) / scale
        size = np.linalg.norm(error, axis=1)
        weight = np.asarray(size <= FAR * np.median(size), dtype=np.float64)
        slope = np.zeros((len(q), 6, 12 + inner.size))
        slope[:, :3, :3] = slope[:, 3:, 3:6] = np.eye(3)
        slope[:, :3, 3:6] = -se3.hat(found[:, :3, 3])
        slope[:, :3, 6:9] = slope[:, 3:, 9:12] = found[:, :3, :3]
        slope[:, :, 12:] = -chain.jacobian(q + zeros)[:, :, inner]
        A = np.vstack([(slope / scale[:, None] * weight[:, None, None]).reshape(6 * len(q), -1), ridge])
        b = np.concatenate([(error * weight[:, None]).ravel(), ridge[:, 12:] @ zeros[inner]])
        step = -np.linalg.lstsq(A, b, rcond=None)[0]
        base, marker = se3.exp(step[:6]) @ base, marker @ se3.exp(step[6:12])
        zeros[inner] += step[12:]
        if np.abs(step).max() < AT_REST:
            break
    return base, marker


def _of_chain(log: CalibrationLog, joints: FloatArray, chain: Chain) -> FloatArray:
    """Return the joints `(n, dof)` of a chain among a log's."""
    count, types = joints.shape[1], log.meta.joint_types
    if not chain.dof <= count <= chain.dof + GRIPPER or (types and not types.startswith(chain.joint_types)):
        kinds = f" ({types})" if types else ""
        raise LogError(
            f"the log has {count} joints{kinds}, the machine {chain.dof} ({chain.joint_types}).",
            hint="Name the machine of this recording, or in a model file the joints and the tool of its robot file.",
            path=log.name,
        )
    return joints[:, : chain.dof]
