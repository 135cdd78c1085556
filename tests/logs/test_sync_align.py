"""Laws of alignment: shifting forth and back, slerp, no value invented in a gap, and a real servo lag removed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import real_data
from sync_support import Recording, one_run, sines, wandering

from gpcorrect import se3
from gpcorrect.errors import DegenerateError, LogError
from gpcorrect.logs.reader import read_log
from gpcorrect.logs.sync import align, estimate_offset, log_offset, shifted_by_motion
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal


def moving_log(delay: float, trajectories: int = 3) -> CalibrationLog:
    """Return a log whose tracker is `delay` s late on the robot's clock."""
    rng = np.random.default_rng(0)
    path, turn = wandering(rng), wandering(rng, 0.4)
    time = np.concatenate([20.0 * k + np.arange(0, 10, 0.02) for k in range(trajectories)])
    number = np.repeat(np.arange(trajectories), len(time) // trajectories)

    def poses(t: FloatArray) -> PoseSignal:
        return PoseSignal(path(t), se3.quaternion_from_matrix(se3.matrix_from_rotvec(turn(t))))

    return CalibrationLog(time, number, np.zeros(len(time)), setpoint_cp=poses(time), tracker_cp=poses(time - delay))


def errors(log: CalibrationLog) -> tuple[FloatArray, FloatArray]:
    """Distances (m) and angles (rad) between command and tracker, where both are known."""
    rows = log.tracker_cp.finite
    move = np.linalg.norm((log.setpoint_cp.position - log.tracker_cp.position)[rows], axis=1)
    a = se3.matrix_from_quaternion(log.setpoint_cp.quaternion[rows])
    b = se3.matrix_from_quaternion(log.tracker_cp.quaternion[rows])
    return move, se3.angle(np.swapaxes(a, 1, 2) @ b)


def test_aligned_tracker_is_the_command():
    """Alignment by the estimated offset leaves only interpolation error, in position and orientation."""
    log = moving_log(0.137)
    before = errors(log)
    after = errors(align(log, log_offset(log)))
    assert np.median(before[0]) > 3e-3
    assert after[0].max() < 1e-4
    assert after[1].max() < 2e-3
    assert np.isclose(log_offset(align(log, log_offset(log))).offset, 0.0, atol=1e-3)


def test_all_that_the_motion_says_is_taken_out_drift_included():
    """A tracker within what a servo may lag, whose clock drifts: auto leaves it alone, who knows better shifts it."""
    log, seen = (moving_log(delay, trajectories=8) for delay in (0.0, 0.08))
    table = [np.interp(log.time / (1.0 + 300e-6), log.time, column) for column in seen.tracker_cp.table.T]
    late = replace(log, tracker_cp=PoseSignal.of(np.column_stack(table)))
    moved = shifted_by_motion(late)
    assert np.median(errors(late)[0]) > 3e-3
    assert errors(moved)[0].max() < 5e-4
    (remark,) = moved.remarks
    assert "shifted, as asked" in remark
    assert " ppm" in remark
    with pytest.raises(DegenerateError, match="not observable"):
        shifted_by_motion(replace(late, tracker_cp=PoseSignal(np.zeros((len(late), 3)))))


def test_nothing_is_invented_at_ends_and_in_gaps():
    """Rows whose shifted time is outside the trajectory or in a gap have no value, all others have one."""
    log = moving_log(0.0)
    keep = ~((log.time > 4.0) & (log.time < 6.0))
    log = log.select(keep)
    moved = align(log, 0.3)
    for _, rows in log.trajectories():
        at, time = log.time[rows] + 0.3, log.time[rows]
        inside = at <= time[-1]
        if time[0] < 4.0:
            inside &= ~((at > 4.0) & (at < 6.0))
        np.testing.assert_array_equal(moved.tracker_cp.finite[rows], inside)


def test_trajectories_of_one_clock_are_aligned_together():
    """Where the clock runs on, a sample late in one trajectory serves the next; where it starts anew, it does not."""
    log = moving_log(0.0, trajectories=1)
    cut = replace(log, trajectory=np.arange(len(log)) // 50)
    whole, parts = align(log, 0.3).tracker_cp, align(cut, 0.3).tracker_cp
    np.testing.assert_array_equal(parts.position, whole.position)
    anew = align(replace(cut, time=log.time % 1.0), 0.3).tracker_cp
    assert anew.finite.sum() == pytest.approx(10 * 35, abs=10)  # a sample at the end of each may round either way


def test_alignment_keeps_everything_else_and_the_input():
    """Only the named signals change; the log that was given does not."""
    log = moving_log(0.1)
    before = log.tracker_cp.position.copy()
    moved = align(log, 0.1)
    np.testing.assert_array_equal(log.tracker_cp.position, before)
    np.testing.assert_array_equal(moved.setpoint_cp.position, log.setpoint_cp.position)
    np.testing.assert_array_equal(moved.time, log.time)
    assert moved.name == log.name


def test_zero_offset_is_the_identity():
    """Alignment by zero returns the same samples to the last bit."""
    log = moving_log(0.1)
    np.testing.assert_array_equal(align(log, 0.0).tracker_cp.position, log.tracker_cp.position)
    np.testing.assert_array_equal(align(log, 0.0).tracker_cp.quaternion, log.tracker_cp.quaternion)


def test_joints_of_an_outside_encoder_can_be_aligned():
    """external_jp moves when it is named, and linear motion is interpolated exactly."""
    time = np.arange(0, 5, 0.1)
    joints = np.outer(time, [1.0, -2.0])
    log = one_run(time, setpoint_jp=joints, external_jp=joints - [0.05, -0.1])
    moved = align(log, 0.05, signals=["external_jp"])
    np.testing.assert_allclose(moved.external_jp[:-1], joints[:-1], atol=1e-12)


def test_an_unobservable_offset_is_not_applied():
    """Alignment refuses an offset that the motion does not determine, and takes the number a person gives."""
    rng = np.random.default_rng(4)
    unknown = estimate_offset([Recording().pair(sines((0.05, 0, 0), (6, 0, 0)), 0.2, rng)])
    log = moving_log(0.1)
    with pytest.raises(DegenerateError, match="not observable"):
        align(log, unknown)
    assert align(log, 0.1).tracker_cp is not None


def test_absent_signals_are_refused():
    """Aligning a signal that the log lacks says which there are."""
    with pytest.raises(LogError, match="cannot align external_jp"):
        align(moving_log(0.1), 0.1, signals=["external_jp"])


def test_recorded_lag_is_found_and_removed():
    """Measured poses lag their setpoints by about 47 ms; aligned by that, they track several times better."""
    log = read_log(real_data("dvrk_motion_1.bag"))
    found = log_offset(log, "measured_cp", "setpoint_cp")
    assert found.observable, found.reason
    assert abs(found.offset - 0.047) < 0.002
    assert np.ptp(found.ci95) < 0.004
    aligned = align(log, found, signals=["measured_cp"])
    before = np.nanmedian(np.linalg.norm(log.measured_cp.position - log.setpoint_cp.position, axis=1))
    after = np.nanmedian(np.linalg.norm(aligned.measured_cp.position - log.setpoint_cp.position, axis=1))
    assert after < before / 3


def test_stop_and_measure_is_in_step():
    """A recording that waits at every sample shows no offset of a tenth of its step."""
    log = read_log(real_data("dvrk_random.csv"))
    found = log_offset(log)
    assert found.observable, found.reason
    assert abs(found.offset) < 0.043
