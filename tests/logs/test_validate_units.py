"""Units that are wrong are recognised: lengths, angles, and what only looks like them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from validate_support import clean_log, findings, pose, scaled_joint

from gpcorrect import se3
from gpcorrect.types import LogMeta


@pytest.mark.parametrize("names", [("tracker_cp",), ("setpoint_cp",), ("tracker_cp", "setpoint_cp", "measured_cp")])
def test_millimetres_for_metres_are_recognised(names):
    """Positions times a thousand are an error, in one signal or in all of them."""
    log = clean_log()
    changes = {n: pose(getattr(log, n), lambda p: 1e3 * p) for n in names}
    found = findings(replace(log, **changes), "position_unit")
    assert {f.severity for f in found} == {"error"}
    assert {f.signal for f in found} == set(names)
    assert {f.hint for f in found} == {f"Set position_scale = 1e-3 under [{n}] in the mapping file." for n in names}


@pytest.mark.parametrize("metres", [0.01, 0.0254])
@pytest.mark.parametrize("size", [0.2, 20.0])
def test_lengths_between_millimetres_and_metres_are_recognised(metres, size):
    """Centimetres and inches of the tracker are an error for small arms and large, and the scale advised is theirs."""
    grown = {n: pose(getattr(clean_log(), n), lambda p: size * p) for n in ("tracker_cp", "setpoint_cp", "measured_cp")}
    log = replace(clean_log(), **{**grown, "tracker_cp": pose(grown["tracker_cp"], lambda p: p / metres)})
    found = findings(log, "position_unit")
    assert {(f.severity, f.signal) for f in found} == {("error", "tracker_cp")}
    assert size < 1 or f"position_scale = {metres:g} " in found[0].hint


def test_another_scale_is_looked_at_first():
    """A tracker at a tenth of its size is a warning; one whose point moves more widely, by another path, is none."""
    tenth = replace(clean_log(), tracker_cp=pose(clean_log().tracker_cp, lambda p: 0.1 * p))
    assert {f.severity for f in findings(tenth, "position_unit")} == {"warning"}
    tracker = clean_log().tracker_cp
    lever = se3.matrix_from_quaternion(tracker.quaternion) @ np.array([0.0, 0.4, 0.3])
    assert not findings(
        replace(clean_log(), tracker_cp=replace(tracker, position=tracker.position + lever)), "position_unit"
    )


def test_a_thousandth_is_recognised():
    """A tracker in kilometres, as from a scale applied twice, is an error."""
    tracker = pose(clean_log().tracker_cp, lambda p: 1e-3 * p)
    assert findings(replace(clean_log(), tracker_cp=tracker), "position_unit")


@pytest.mark.parametrize("joint", [0, 1, 3, 5])
@pytest.mark.parametrize("name", ["setpoint_jp", "measured_jp", "external_jp"])
def test_degrees_for_radians_are_recognised(name, joint):
    """One joint of one signal in degrees is named, in that signal and no other."""
    found = findings(scaled_joint(name, joint, np.rad2deg(1.0)), "joint_unit")
    assert [f.signal for f in found] == [name]
    assert f"joint {joint + 1} " in found[0].message


def test_all_joints_in_degrees_are_recognised():
    """A whole log in degrees is recognised without a signal in radians beside it."""
    log = clean_log()
    degrees = {
        n: getattr(log, n) * np.where(np.arange(6) == 2, 1.0, np.rad2deg(1.0)) for n in ("setpoint_jp", "measured_jp")
    }
    log = replace(log, external_jp=None, tracker_cp=None, **degrees)
    assert len(findings(log, "joint_unit")) == 10
    assert not findings(log, "joint_limit")


def test_insertion_in_millimetres_and_times_180_over_pi_are_distinguished():
    """An insertion in mm, and one in the 180/pi metres of RAVEN-II messages, are named as what they are."""
    (mm,) = findings(scaled_joint("measured_jp", 2, 1e3), "joint_unit")
    (scaled,) = findings(scaled_joint("measured_jp", 2, np.rad2deg(1.0)), "joint_unit")
    assert "millimetres" in mm.message
    assert "180/pi" in scaled.message


def test_ratios_are_seen_without_joint_types():
    """Without a word on joint kinds, measured in degrees beside setpoints in radians is still seen."""
    log = scaled_joint("measured_jp", 0, np.rad2deg(1.0))
    found = findings(replace(log, meta=LogMeta(), external_jp=None), "joint_unit")
    assert [f.signal for f in found] == ["measured_jp"]


def test_degrees_in_every_signal_are_seen_without_joint_types():
    """Without a word on joint kinds, what is neither radians nor metres is named; joints in radians are not."""
    log = replace(clean_log(), meta=LogMeta(), external_jp=None)
    assert not findings(log, "joint_unit")
    degrees = {n: np.rad2deg(getattr(log, n)) for n in ("setpoint_jp", "measured_jp")}
    found = findings(replace(log, tracker_cp=None, **degrees), "joint_unit")
    assert {f.signal for f in found} == set(degrees)


def test_wrong_gains_and_offsets_are_not_units():
    """A joint 30 % off in gain and 10 degrees off in zero is a badly calibrated one, in the right unit."""
    log = clean_log()
    table = log.external_jp * np.array([1.3, 0.7, 1.0, 1.0, 1.0, 1.0]) + 0.17
    assert not findings(replace(log, external_jp=table), "joint_unit")
