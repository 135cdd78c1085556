"""Laws of the dry run as a whole: silent on clean logs, plain in its output, never an exception."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support import real_data
from validate_support import clean_log, codes

from gpcorrect.errors import LogError
from gpcorrect.logs.checks import CHECKS, Evidence
from gpcorrect.logs.reader import read_log
from gpcorrect.logs.validate import validate_log
from gpcorrect.types import CalibrationLog, LogMeta, PoseSignal


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_log_raises_no_alarm(seed):
    """A log without a fault has neither errors nor warnings, and its offsets are near zero."""
    report = validate_log(clean_log(seed))
    assert report.findings == tuple(f for f in report.findings if f.severity == "info")
    assert report.ok
    assert codes(report, "info") <= {"time_offset", "servo_lag", "quaternion_sign"}
    assert all(abs(o.offset) < 0.005 for o in report.offsets)


def test_facts_are_those_of_the_log():
    """Sizes, rate, duration and ranges are what the log was made with."""
    facts = validate_log(clean_log()).facts
    assert facts["samples"] == 1600
    assert facts["trajectories"] == {"count": 4, "shortest": 400, "median": 400, "longest": 400}
    assert facts["rate_hz"] == pytest.approx(50.0)
    assert facts["seconds"] == pytest.approx(4 * 399 / 50)
    assert set(facts["signals"]) == set(clean_log().signals)
    low, high = facts["signals"]["setpoint_jp"]["min"], facts["signals"]["setpoint_jp"]["max"]
    np.testing.assert_allclose([low, high], [clean_log().setpoint_jp.min(axis=0), clean_log().setpoint_jp.max(axis=0)])


def test_reports_are_plain_json():
    """The report of any log is strict JSON: no NaN, no arrays."""
    for log in (clean_log(), _holed(clean_log()), _tiny(0), _tiny(1), _tiny(2)):
        report = validate_log(log).to_dict()
        assert json.loads(json.dumps(report, allow_nan=False)) == report


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 6, 12])
def test_short_logs_are_looked_at_without_an_exception(rows):
    """Logs of any length, in every combination of signals, give a report."""
    log = clean_log().select(slice(0, rows))
    validate_log(log)
    for name in log.signals:
        validate_log(replace(log, **{name: None}))
        only = {n: None for n in log.signals if n != name}
        validate_log(replace(log, **only))
    assert (rows == 0) == ("empty" in codes(validate_log(log), "error"))


def test_hopeless_logs_are_looked_at_without_an_exception():
    """All values missing, infinite, zero, or stamps without order: findings, no exception."""
    log = clean_log()
    n = len(log)
    rng = np.random.default_rng(0)
    for fill in (np.nan, np.inf, 0.0, 1e300):
        pose = PoseSignal(np.full((n, 3), fill), np.full((n, 4), fill))
        joints = np.full((n, 6), fill)
        broken = replace(
            log, setpoint_cp=pose, measured_cp=pose, tracker_cp=pose, setpoint_jp=joints, external_jp=joints
        )
        assert not validate_log(broken).ok
    for time in (np.full(n, np.nan), np.zeros(n), -log.time, rng.permutation(log.time)):
        assert not validate_log(replace(log, time=time)).ok


numbers = st.floats(width=32) | st.sampled_from([0.0, 1.0, np.nan])


@given(data=st.data(), rows=st.integers(1, 40))
@settings(max_examples=30, deadline=None)
def test_garbage_is_looked_at_without_an_exception(data, rows):
    """Any numbers in any signals, any stamps and trajectory numbers: a report that is strict JSON."""

    def table(columns):
        return data.draw(arrays(np.float64, (rows, columns), elements=numbers))

    log = CalibrationLog(
        data.draw(arrays(np.float64, rows, elements=numbers)),
        data.draw(arrays(np.int64, rows, elements=st.integers(-1, 2))),
        np.zeros(rows),
        setpoint_cp=PoseSignal(table(3), table(4)),
        tracker_cp=PoseSignal(table(3), table(4)),
        setpoint_jp=table(6),
        measured_jp=table(6),
        meta=data.draw(st.sampled_from([LogMeta(), LogMeta(arm="dvrk_psm"), LogMeta(joint_types="RP")])),
    )
    json.dumps(validate_log(log).to_dict(), allow_nan=False)


def test_every_check_is_asked():
    """The registry is what a report asks, and a report without checks has no findings."""
    assert validate_log(clean_log()).findings == validate_log(clean_log(), CHECKS).findings
    assert validate_log(clean_log(), checks=()).findings == ()


def test_the_gravest_findings_come_first():
    """Errors stand before warnings before information."""
    log = replace(clean_log(), time=clean_log().time[::-1])
    order = [("error", "warning", "info").index(f.severity) for f in validate_log(log).findings]
    assert order == sorted(order)
    assert len(set(order)) > 1


@pytest.mark.parametrize(
    ("robot", "arm", "name"),
    [
        ("dVRK", "psm_classic", "dvrk_psm"),
        ("dVRK", "PSM2", "dvrk_psm"),
        ("RAVEN-II", "left", "raven2_left"),
        ("raven2", "right arm", "raven2_right"),
        ("", "raven2_left", "raven2_left"),
        ("dvrk_psm", "", "dvrk_psm"),
    ],
)
def test_the_sidecar_names_the_arm(robot, arm, name):
    """Robot and arm of the sidecar, however spelled, name an arm that is known."""
    found = Evidence(replace(clean_log(), meta=LogMeta(robot=robot, arm=arm))).arm
    assert found is not None
    assert found.name == name


def test_joints_are_named_with_r_and_p_alone():
    """Types are read however they are spaced and written; a letter that names no joint is refused at once."""
    assert LogMeta(joint_types="r, R,p rRr").joint_types == "RRPRRR"
    with pytest.raises(LogError, match=r"'RRPRiR' does not name each joint with R or P"):
        LogMeta(joint_types="RRPRiR")


@pytest.mark.parametrize(("robot", "arm"), [("", ""), ("UR5", "left"), ("RAVEN-II", ""), ("dVRK", "psm_si")])
def test_an_unknown_arm_is_no_arm(robot, arm):
    """What the sidecar leaves open is not guessed."""
    assert Evidence(replace(clean_log(), meta=LogMeta(robot=robot, arm=arm))).arm is None


def test_real_random_motion_is_described_as_it_is():
    """The random motion is irregular with gaps, holds the wrist point and one pose past a limit; no more."""
    report = validate_log(read_log(real_data("dvrk_random.csv")))
    assert codes(report, "error", "warning") == {"irregular", "gap", "wrist_point", "joint_limit"}
    assert report.facts["step_s"]["median"] == pytest.approx(0.43, abs=0.005)
    assert report.facts["step_s"]["max"] == pytest.approx(6.44, abs=0.01)
    (limit,) = [f for f in report.findings if f.code == "joint_limit"]
    assert limit.count == 1


@pytest.mark.parametrize("name", ["dvrk_wiggle_1.csv", "dvrk_wiggle_2.csv"])
def test_real_wiggles_only_lack_a_second_trajectory(name):
    """The wiggle recordings raise one warning: there is one trajectory."""
    report = validate_log(read_log(real_data(name)))
    assert codes(report, "error", "warning") == {"one_trajectory"}


def test_real_bag_only_lacks_a_tracker():
    """The bag raises two warnings, one trajectory and no outside truth, and tells of its servo lag."""
    report = validate_log(read_log(real_data("dvrk_motion_1.bag")))
    assert codes(report, "error", "warning") == {"one_trajectory", "no_observation"}
    assert "servo_lag" in codes(report, "info")


def _tiny(rows: int) -> CalibrationLog:
    return clean_log().select(slice(0, rows))


def _holed(log: CalibrationLog) -> CalibrationLog:
    position = log.tracker_cp.position.copy()
    position[:300] = np.nan
    return replace(log, tracker_cp=PoseSignal(position), time=np.where(np.arange(len(log)) == 7, np.nan, log.time))
