"""Each check of time and cutting speaks up for its planted fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sync_support import wandering
from validate_support import clean_log, codes, findings

from gpcorrect import se3
from gpcorrect.logs.validate import validate_log
from gpcorrect.types import CalibrationLog, PoseSignal


def with_time(change):
    """Return the clean log with its time put through a function."""
    return replace(clean_log(), time=change(clean_log().time.copy()))


def test_repeated_and_backward_stamps_are_errors_with_their_rows():
    """A repeated stamp and a backward one are named with the rows where they are."""

    def fault(time):
        time[100] = time[99]
        time[701] = time[700] - 0.5
        return time

    log = with_time(fault)
    (repeated,) = findings(log, "stamp_repeated")
    (backward,) = findings(log, "stamp_backward")
    assert repeated.severity == backward.severity == "error"
    assert repeated.rows == (100,)
    assert backward.rows == (701,)
    assert "0.5 s" in backward.message


def test_missing_stamps_are_errors():
    """A sample without time is named."""
    (finding,) = findings(with_time(lambda t: np.where(np.arange(len(t)) == 12, np.nan, t)), "stamp_missing")
    assert finding.rows == (12,)


def test_a_new_trajectory_may_start_its_clock_anew():
    """Time that restarts with each trajectory is in order."""
    log = with_time(lambda t: t % 10.0)
    assert not codes(validate_log(log), "error", "warning")


def test_milliseconds_are_seen_beside_faults_of_the_tracker():
    """A log in milliseconds at 50 Hz is refused although two samples in a hundred jump by decimetres."""
    log = with_time(lambda t: 1e3 * t)
    position = log.tracker_cp.position.copy()
    position[::50] += 0.2
    (found,) = findings(replace(log, tracker_cp=PoseSignal(position, log.tracker_cp.quaternion)), "time_unit")
    assert "milliseconds" in found.message


def test_milliseconds_are_seen_in_a_log_of_joints():
    """Joints alone show milliseconds too, and none where time is in seconds."""
    joints = {"setpoint_cp": None, "measured_cp": None, "tracker_cp": None}
    assert findings(replace(with_time(lambda t: 1e3 * t), **joints), "time_unit")
    assert not findings(replace(clean_log(), **joints), "time_unit")


def test_gaps_are_counted_with_the_longest():
    """A pause of two seconds inside a trajectory is one gap; pauses between trajectories are none."""
    (gap,) = findings(with_time(lambda t: t + 2.0 * (np.arange(len(t)) >= 600)), "gap")
    assert gap.severity == "warning"
    assert gap.rows == (600,)
    assert "2.02 s" in gap.message


def test_uneven_sampling_is_reported():
    """Steps that vary by half of the median are irregular; two percent of jitter is not."""
    rng = np.random.default_rng(0)
    uneven = with_time(lambda t: t + 0.006 * rng.uniform(-1, 1, len(t)))
    assert findings(uneven, "irregular")
    assert not findings(with_time(lambda t: t + 0.0002 * rng.uniform(-1, 1, len(t))), "irregular")


@pytest.mark.parametrize(
    ("scale", "origin", "unit"),
    [
        (1e3, 0.0, "milliseconds"),
        (1e6, 0.0, "microseconds"),
        (1e9, 0.0, "nanoseconds"),
        (1e3, 1.7e9, "milliseconds"),
        (1e6, 1.7e9, "microseconds"),
        (1e9, 1.7e9, "nanoseconds"),
    ],
)
def test_time_in_other_units_is_guessed(scale, origin, unit):
    """Milli-, micro- and nanoseconds, since 1970 or since the start, are distinguished."""
    (finding,) = findings(with_time(lambda t: scale * (origin + t)), "time_unit")
    assert finding.severity == "error"
    assert unit in finding.message
    assert f"{1 / scale:g}" in finding.hint


@pytest.mark.parametrize("rate", [0.5, 2.0, 1000.0])
def test_slow_and_fast_logs_are_in_seconds(rate):
    """A sample in two seconds, or a thousand a second, since 1970, is not taken for another unit."""
    assert not findings(with_time(lambda t: 1.7e9 + 50.0 * t / rate), "time_unit")


def test_one_trajectory_can_be_held_out_in_part_only():
    """A log of one trajectory is warned about."""
    log = clean_log().select(slice(0, 400))
    [found] = findings(log, "one_trajectory")
    assert "errors are measured on a block of it" in found.message


def test_short_and_torn_trajectories_are_named():
    """A trajectory of five samples and one that comes back are named by their numbers."""
    number = np.array(clean_log().trajectory)
    number[395:400] = 9
    number[1500:] = 1
    log = replace(clean_log(), trajectory=number)
    (short,) = findings(log, "short_trajectory")
    (torn,) = findings(log, "torn_trajectory")
    assert short.rows == (9,)
    assert torn.rows == (1,)


def delayed(seconds):
    """Return the clean log with a tracker that is late by whole samples."""
    log, shift = clean_log(), round(seconds * 50)
    tracker = log.tracker_cp
    rows = np.arange(len(log))
    late = np.where(rows % 400 >= shift, rows - shift, rows)
    return replace(log, tracker_cp=tracker[late], external_jp=log.external_jp[late])


def test_a_late_tracker_is_a_warning_with_its_offset():
    """A tracker 200 ms late is a warning that says so; in step it is information."""
    (late,) = [f for f in findings(delayed(0.2), "time_offset") if f.signal == "tracker_cp"]
    assert late.severity == "warning"
    assert "200" in late.message or "199" in late.message
    assert {f.severity for f in findings(clean_log(), "time_offset")} == {"info"}


@pytest.mark.parametrize(("turn", "said"), [(slice(None), "looks the same"), (slice(None, None, -1), "reversed time")])
def test_a_log_in_reversed_time_is_no_lag(turn, said):
    """Of a tracker 60 ms behind rows that stand in reversed order make one ahead, which no lag of the robot does."""
    log = clean_log()
    late = PoseSignal(np.roll(log.tracker_cp.position, 3, axis=0), np.roll(log.tracker_cp.quaternion, 3, axis=0))
    poses = {"setpoint_cp": log.setpoint_cp, "tracker_cp": late}
    turned = {n: PoseSignal(p.position[turn], p.quaternion[turn]) for n, p in poses.items()}
    (found,) = findings(CalibrationLog(log.time, log.trajectory, log.session, **turned), "time_offset")
    assert found.severity == "warning"
    assert said in found.hint


def test_a_robot_at_rest_hides_its_clock():
    """Where nothing moves, the offset is said to be unknown, not zero."""
    log = clean_log().select(np.zeros(300, dtype=int))
    log = replace(log, time=np.arange(300) / 50, trajectory=np.arange(300) // 150)
    noise = np.random.default_rng(1).normal(size=(300, 3))
    log = replace(log, tracker_cp=PoseSignal(log.tracker_cp.position + 1e-4 * noise))
    (finding,) = [f for f in findings(log, "time_offset_unknown") if f.signal == "tracker_cp"]
    assert "does not move" in finding.message or "correlate" in finding.message


def test_an_offset_beyond_the_search_is_not_passed_over():
    """A tracker four seconds late is an alarm of one kind or the other, never silence."""
    report = validate_log(delayed(4.0))
    assert codes(report, "error", "warning") & {"unrelated", "time_offset_unknown"}


def test_a_fast_clock_is_warned_about():
    """A tracker clock that is 300 ppm fast over minutes is a drift."""
    rng = np.random.default_rng(2)
    path, time = wandering(rng), np.arange(0, 150, 0.02)
    seen = path((time - 0.05) * (1 - 3e-4)) @ se3.matrix_from_rotvec(np.array([1.0, 0, 0])).T
    log = CalibrationLog(
        time,
        np.arange(len(time)) // 500,
        np.zeros(len(time)),
        setpoint_cp=PoseSignal(path(time)),
        tracker_cp=PoseSignal(seen + 1e-4 * rng.normal(size=seen.shape)),
    )
    (drift,) = findings(log, "clock_drift")
    assert "+300" in drift.message or "+299" in drift.message
