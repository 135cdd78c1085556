from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mocap_support import mapping, write_motive
from scipy.spatial.transform import Rotation
from sync_support import wandering

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log, with_tracker
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.types import CalibrationLog, PoseSignal

AHEAD = -1_700_000_123.25  # s; the robot stamps seconds since 1970, the cameras count from zero


def session(seed: int = 0, ahead: float = AHEAD, rows: int = 1500) -> tuple[CalibrationLog, CalibrationLog]:
    """Record a robot at 50 Hz, and a tracker at 100 Hz that began earlier and ended later."""
    rng = np.random.default_rng(seed)
    path, turn = wandering(rng), wandering(rng)
    robot_time, take_time = np.arange(rows) / 50 + 5.0, np.arange(2 * rows + 1200) / 100

    def pose(t: np.ndarray) -> PoseSignal:
        return PoseSignal(path(t), Rotation.from_rotvec(0.5 * turn(t)).as_quat(scalar_first=True))

    seen = pose(take_time)
    shifted = seen.position @ Rotation.from_rotvec([0.4, 1.0, -0.3]).as_matrix().T + [1.0, 0.2, 0.5]
    noisy = PoseSignal(shifted + 1e-4 * rng.normal(size=shifted.shape), seen.quaternion)
    zeros = np.zeros(len(robot_time), dtype=np.int64)
    robot = CalibrationLog(robot_time - ahead, np.arange(rows) // 300, zeros, measured_cp=pose(robot_time))
    none = np.zeros(len(take_time), dtype=np.int64)
    take = CalibrationLog(take_time, none, none, tracker_cp=noisy, extra={"marker_rms": take_time}, name="take")
    return replace(robot, setpoint_cp=robot.measured_cp, name="robot"), take


def test_the_motion_tells_how_two_clocks_lie_wherever_they_begin():
    """The tracker lands on the robot's rows within a millisecond, decades apart or not."""
    for ahead in (AHEAD, 0.0, 17.5):
        robot, take = session(1, ahead)
        joined = with_tracker(robot, take)
        np.testing.assert_array_equal(joined.time, robot.time)
        expected = robot.time + ahead
        np.testing.assert_allclose(joined.extra["marker_rms"], expected, atol=1e-3)
        assert joined.tracker_cp.finite.all()
        assert "found by measured_cp. Slack" in joined.remarks[-1]


def test_a_lag_that_is_taken_for_clock_is_said():
    """Without a reported pose a lag of 40 ms behind the commands moves the clock by as much, and the remark says so."""
    robot, take = session(1, 0.0)
    late = interpolate(Stream("setpoint_cp", robot.time, robot.setpoint_cp), robot.time + 0.04)
    joined = with_tracker(replace(robot, measured_cp=None, setpoint_cp=late).select(slice(0, 1490)), take)
    (remark,) = (said for said in joined.remarks if "found by setpoint_cp" in said)
    assert float(remark.split("runs ")[1].split()[0]) == pytest.approx(0.04, abs=5e-4)
    assert "lags behind its commands is taken for clock" in remark


def test_a_clock_that_runs_fast_is_said_with_what_a_constant_number_loses():
    """A tracker's clock 1000 ppm fast: its rate, and the 50 ms at either end of 100 s, stand in the remark."""
    robot, take = session(3, 0.0, rows=5000)
    joined = with_tracker(robot, replace(take, time=take.time * 1.001))
    (remark,) = (said for said in joined.remarks if "ppm fast" in said)
    assert float(remark.split("and ")[1].split(" ppm")[0]) == pytest.approx(1000, abs=20)
    assert float(remark.split("lose ")[1].split(" ms")[0]) == pytest.approx(50, abs=2)
    assert not any("ppm" in said for said in with_tracker(*session(1, 0.0)).remarks)


def test_a_given_shift_is_applied():
    """The motion is not asked then, and rows beyond the take are missing."""
    robot, take = session(2)
    joined = with_tracker(robot, take.select(slice(0, 2000)), AHEAD)
    inside = robot.time + AHEAD <= take.time[1999]
    np.testing.assert_array_equal(joined.tracker_cp.finite, inside)
    assert "of 1500 samples have no tracker" in joined.remarks[-1]


def test_what_does_not_go_together_is_refused():
    """Each with what is wrong and where."""
    robot, take = session(3)
    with pytest.raises(LogError, match="share no time"):
        with_tracker(robot, take, 0.0)
    for seed in range(60, 64):
        with pytest.raises(LogError, match=r"take: the motion does not tell.*--time-offset"):
            with_tracker(robot, session(seed)[1])
    with pytest.raises(LogError, match="tracker of its own"):
        with_tracker(with_tracker(robot, take), take)
    with pytest.raises(LogError, match="robot: expected one clock"):
        with_tracker(replace(robot, time=np.tile(robot.time[:300], 5)), take)
    with pytest.raises(LogError, match="expected a recording with a tracker"):
        with_tracker(robot, robot)
    with pytest.raises(LogError, match="no pose to match clocks by"):
        with_tracker(replace(robot, setpoint_cp=None, measured_cp=None), take)


def test_an_export_of_motive_is_put_beside_a_robots_log(tmp_path: Path):
    """The whole way: a file of the cameras, its body named, on the robot's clock."""
    from mocap_support import Tool

    robot, take = session(5)
    gone = np.zeros(len(take), dtype=bool)
    gone[1000:1010] = True
    rotation = Rotation.from_quat(take.tracker_cp.quaternion, scalar_first=True)
    tool = Tool(take.time, take.tracker_cp.position, rotation, np.zeros((len(take), 5, 3)), gone)
    path = write_motive(tmp_path / "Take 2026-11-21.csv", tool, names=("tool", "base"), rotation="ZYX")
    joined = with_tracker(robot, read_log(path, columns=mapping(tmp_path / "m.toml", {"body": "tool"})))
    assert 0 < (~joined.tracker_cp.finite).sum() <= 7
    whole = with_tracker(robot, take)
    seen = joined.tracker_cp.finite
    np.testing.assert_allclose(joined.tracker_cp.position[seen], whole.tracker_cp.position[seen], atol=1e-4)
