"""Logs of poses only: the joints behind them are found again, and a wrong arm is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect.discrepancy.recording.commanded import joint_path_of_poses, with_joint_paths
from gpcorrect.errors import DataError
from gpcorrect.sim import Model, machine_of, model_from_dict
from gpcorrect.sim.joint_motion import joint_motion_log
from gpcorrect.types import CalibrationLog, PoseSignal


def arm(name: str, *joints: int) -> Model:
    return model_from_dict({"arm": name, "joints": list(joints), "log_rate_hz": 20.0})


def poses_only(log: CalibrationLog) -> CalibrationLog:
    """Return the log as a robot without joint signals would write it."""
    return replace(log, setpoint_jp=None, measured_jp=None, measured_jv=None, measured_jf=None, external_jp=None)


@pytest.mark.parametrize(
    ("name", "joints"), [("dvrk_psm", (1, 2, 3, 4, 5, 6)), ("raven2_left", (1, 2, 3)), ("raven2_right", (1, 2))]
)
def test_joints_come_back_from_the_poses_they_made(name: str, joints: tuple[int, ...]) -> None:
    """Commanded and reported poses give the very joints that they were computed from, whatever number of them moves."""
    model = arm(name, *joints)
    log = joint_motion_log(model, 4, 5.0, seed=3)
    found, remarks = with_joint_paths(poses_only(log), machine_of(model).body)
    assert found.setpoint_jp is not None
    assert found.measured_jp is not None
    np.testing.assert_allclose(found.setpoint_jp, log.setpoint_jp, atol=1e-8)
    np.testing.assert_allclose(found.measured_jp, log.measured_jp, atol=1e-8)
    assert any("inverse kinematics" in r for r in remarks)


def test_three_joints_need_no_orientation() -> None:
    """Positions alone tell three joints; six need orientations, and the message says so."""
    model = arm("raven2_left", 1, 2, 3)
    log = joint_motion_log(model, 3, 5.0, seed=1)
    bare = PoseSignal(log.setpoint_cp.position)
    q, _ = joint_path_of_poses(machine_of(model).body, bare, log.trajectory)
    np.testing.assert_allclose(q, log.setpoint_jp, atol=1e-8)
    with pytest.raises(DataError, match="positions alone do not tell 6 joints"):
        joint_path_of_poses(machine_of(arm("dvrk_psm", 1, 2, 3, 4, 5, 6)).body, bare, log.trajectory)


def test_missing_poses_leave_their_rows_out() -> None:
    """A row without a commanded pose has no motor position: it is left out, and said so."""
    model = arm("raven2_left", 1, 2, 3)
    log = poses_only(joint_motion_log(model, 3, 5.0, seed=2))
    position = np.array(log.setpoint_cp.position)
    position[40:45] = np.nan
    holed = replace(log, measured_cp=None, setpoint_cp=replace(log.setpoint_cp, position=position))
    found, remarks = with_joint_paths(holed, machine_of(model).body)
    assert len(found) == len(log) - 5
    assert any(r.startswith("5 of") for r in remarks)


def test_poses_without_a_number_are_refused() -> None:
    """A signal that was never recorded says so, and ends in no error of its own."""
    model = arm("raven2_left", 1, 2, 3)
    nothing = PoseSignal(np.full((20, 3), np.nan), np.full((20, 4), np.nan))
    with pytest.raises(DataError, match="setpoint_cp holds no whole pose"):
        joint_path_of_poses(machine_of(model).body, nothing, np.zeros(20, dtype=np.int64), "setpoint_cp")


def test_poses_of_another_arm_are_refused() -> None:
    """Poses that the nominal arm cannot reach are refused, with by how much it misses them."""
    log = poses_only(joint_motion_log(arm("raven2_left", 1, 2, 3, 4, 5, 6), 3, 5.0, seed=2))
    shifted = replace(
        log, measured_cp=None, setpoint_cp=replace(log.setpoint_cp, position=log.setpoint_cp.position + 1)
    )
    with pytest.raises(DataError, match=r"misses the poses of setpoint_cp.* by .* mm"):
        with_joint_paths(shifted, machine_of(arm("raven2_left", 1, 2, 3)).body)


def test_a_log_with_joints_keeps_its_own() -> None:
    """Joint signals that were recorded are never replaced."""
    model = arm("dvrk_psm", 1, 2, 3)
    log = joint_motion_log(model, 3, 5.0, seed=4)
    same, remarks = with_joint_paths(replace(log, measured_jp=None), machine_of(model).body)
    assert same.measured_jp is None
    assert same.setpoint_jp is log.setpoint_jp or np.array_equal(same.setpoint_jp, log.setpoint_jp)
    assert remarks == ()
