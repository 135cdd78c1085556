"""What the kinematics of an arm adds to a recording: poses of joints, and true joints of a tracker's poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint, dvrk_psm
from gpcorrect.calibration import with_outside_joints, with_poses
from gpcorrect.errors import DegenerateError, LogError
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

CHAIN = dvrk_psm().chain
BASE = se3.exp(np.array([0.3, -0.2, 0.9, 0.4, -0.7, 1.1]))
MARKER = se3.exp(np.array([0.01, 0.02, -0.03, 0.2, 0.5, -0.3]))


def poses_of(T: FloatArray) -> PoseSignal:
    return PoseSignal(T[:, :3, 3], se3.quaternion_from_matrix(T[:, :3, :3]))


def recorded(away: FloatArray, outliers: int = 0, gripper: int = 0) -> CalibrationLog:
    """Return a tracker's recording of joints that are `away` (6,) from what the arm reports, with slack."""
    rng = np.random.default_rng(4)
    time = np.arange(400) * 0.02
    middle, reach = CHAIN.limits.mean(axis=1), 0.25 * np.ptp(CHAIN.limits, axis=1)
    q = middle + reach * np.sin(time[:, None] * rng.uniform(0.5, 2.5, 6) + rng.uniform(0, 6, 6))
    slack = 3e-3 * np.sign(np.gradient(q[:, 1]))
    true = q + away + slack[:, None] * (np.arange(6) == 1)
    T = BASE @ CHAIN.forward(true) @ MARKER
    T[rng.choice(400, outliers, replace=False), :3, 3] += 0.05
    still = np.zeros(400, dtype=np.int64)
    reported = np.hstack([q, np.zeros((400, gripper))])
    return CalibrationLog(time, still, still, tracker_cp=poses_of(T), measured_jp=reported, external_jp=true)


def test_a_tracker_stands_in_for_encoders() -> None:
    """Joints' zeros and slack are found from poses alone, through unknown base, marker and outliers.

    The zeros of the first and of the last joint are a turn of base and marker; a gripper's joint is left out.
    """
    log = recorded(np.array([0, 0.01, -0.002, 0.03, -0.02, 0]), outliers=20, gripper=1)
    found = with_outside_joints(replace(log, external_jp=None), CHAIN)
    assert found.measured_jp.shape == found.external_jp.shape == (400, 6)
    assert found.meta.joint_types == CHAIN.joint_types
    off = np.abs(found.external_jp - log.external_jp)
    assert (np.median(off, axis=0) < 1e-3).all(), off
    assert with_outside_joints(log, CHAIN) is log


def test_joints_give_the_poses_that_a_log_lacks() -> None:
    """Commanded and reported poses are the chain's of the joints; poses that are logged stay."""
    log = recorded(np.zeros(6))
    log = replace(log, setpoint_jp=log.measured_jp + 1e-3)
    whole = with_poses(log, CHAIN)
    np.testing.assert_allclose(whole.setpoint_cp.position, CHAIN.forward(log.setpoint_jp)[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(whole.measured_cp.position, CHAIN.forward(log.measured_jp)[:, :3, 3], atol=1e-12)
    assert with_poses(whole, CHAIN) is whole


def test_what_poses_do_not_tell_is_refused() -> None:
    """Positions alone, another arm's joints, and an arm with more joints than a pose has numbers."""
    log = replace(recorded(np.zeros(6)), external_jp=None)
    with pytest.raises(LogError, match="no orientations"):
        with_outside_joints(replace(log, tracker_cp=PoseSignal(log.tracker_cp.position)), CHAIN)
    unseen = PoseSignal(np.full((400, 3), np.nan), log.tracker_cp.quaternion)
    with pytest.raises(LogError, match="no row has all joints"):
        with_outside_joints(replace(log, tracker_cp=unseen), CHAIN)
    with pytest.raises(LogError, match="the log has 6 joints, the machine 3"):
        with_poses(log, replace(CHAIN, joints=CHAIN.joints[:3]))
    seven = Chain((*CHAIN.joints, Joint("R", 0.3, 0.01, 0.0, 0.0, -1.0, 1.0)), CHAIN.convention)
    with pytest.raises(DegenerateError, match="poses do not determine the 7 joints"):
        with_outside_joints(replace(log, measured_jp=np.hstack([log.measured_jp, log.measured_jp[:, :1]])), seven)
