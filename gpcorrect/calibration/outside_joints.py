"""What a recording lacks, by the kinematics of its arm: poses of joints, and true joints of a tracker's poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Chain, workspace
from gpcorrect.calibration.arm_kinematics import GRIPPER, SOURCES, pose_matrices, require_determined
from gpcorrect.errors import LogError
from gpcorrect.rigid import register
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

SAMPLES = 1000
"""Postures in the registration: two dozen unknowns need no more."""
STEPS = 20
"""Gauss-Newton steps of the registration; those of well-determined ones end after five."""
AT_REST = 1e-8
"""rad: a step that is smaller ends the registration."""
FAR = 4.0
"""Median errors beyond which a sample does not count: no noise of six numbers lies there, outliers do. By hand."""
ZERO_WEIGHT = 1e-3
"""Weight of a zero (rad, m) against a sample: it decides only where the motion does not tell zeros from other moves."""


def with_poses(log: CalibrationLog, chain: Chain) -> CalibrationLog:
    """Return a log with the poses that its joints stand for, where it has none: of its commands, and as reported.

    Parameters
    ----------
    log : CalibrationLog
        n samples; joints behind the chain's, such as a gripper's, are not looked at.
    chain : Chain
        The arm's.

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
            found[pose_name] = PoseSignal(T[:, :3, 3], se3.quaternion_from_matrix(T[:, :3, :3]))
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
    chain : Chain
        The arm's.

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
    T = chain.forward(q[rows])
    length = workspace(T)
    require_determined(chain, q[rows], length)
    nominal = PoseSignal(T[:, :3, 3], se3.quaternion_from_matrix(T[:, :3, :3]))
    rigid = register(tracker[rows], nominal, log.trajectory[rows], "auto", held_out=False).model
    base, marker = se3.pose(rigid.R_position, rigid.t), se3.pose(rigid.R_right, rigid.offset)
    seen = pose_matrices(tracker[rows])
    few = np.unique(np.linspace(0, len(rows) - 1, SAMPLES).astype(np.int64))
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
