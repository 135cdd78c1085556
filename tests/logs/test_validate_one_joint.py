"""Checks of joints by themselves: what signals of all joints together hide."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support import real_data
from validate_support import clean_log, findings

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.validate import refuse_misread, validate_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta

N = len(clean_log())


def outside(joint: int, values: FloatArray) -> CalibrationLog:
    """Return the clean log, its kinds of joints unknown, with another outside reading of one joint."""
    table = clean_log().external_jp.copy()
    table[:, joint] = values
    return replace(clean_log(), external_jp=table, tracker_cp=None, meta=LogMeta())


@pytest.mark.parametrize("turns", [-2, -1, 1])
def test_an_encoder_a_whole_turn_off_is_refused_with_the_offset_that_mends_it(turns: int) -> None:
    """It is no zero to be learned, for a command would hold the turn; nor is it called degrees beyond 2 pi."""
    log = outside(1, clean_log().external_jp[:, 1] + turns * 2 * np.pi)
    (found,) = validate_log(log).errors
    assert (found.code, found.signal) == ("joint_turn", "external_jp")
    assert "joint 2 reads" in found.message
    assert f"offset = {-turns * 2 * np.pi:.6g}" in found.hint
    with pytest.raises(LogError, match="joint 2 reads"):
        refuse_misread(log, ("external_jp", "measured_jp"))


def test_a_motor_a_whole_turn_off_is_not_laid_on_the_outside_encoder() -> None:
    """The signal that differs from both others is named."""
    table = clean_log().measured_jp.copy()
    table[:, 0] -= 2 * np.pi
    assert {f.signal for f in findings(replace(clean_log(), measured_jp=table), "joint_turn")} == {"measured_jp"}


def test_a_reading_that_wraps_or_jumps_is_named_with_its_row() -> None:
    """From some row on, or wherever the joint passes the seam; the tracker's motion is not blamed."""
    path = clean_log().external_jp[:, 3]
    jump = np.where(np.arange(N) >= 700, 2 * np.pi, 0.0)
    (found,) = validate_log(outside(3, path + jump)).errors
    assert found.message == "joint 4 jumps by a turn against measured_jp, once at row 700."
    seam = float(np.median(path))
    (found,) = validate_log(outside(3, np.where(path > seam, path - 2 * np.pi, path))).errors
    assert "joint 4 jumps by a turn" in found.message
    (lone,) = findings(outside(3, path + 2 * np.pi * (np.arange(N) == 700)), "joint_turn")
    assert lone.severity == "warning"


@pytest.mark.parametrize("offset", [0.3, 2.0, 3.0, -1.5])
def test_a_zero_within_a_turn_is_learned(offset: float) -> None:
    """Also where differences lie about half a turn, some above and some below."""
    assert not findings(outside(4, clean_log().external_jp[:, 4] + offset), "joint_turn")


def test_a_dead_or_frozen_encoder_of_one_joint_is_named() -> None:
    """The others move, so the signal as a whole is neither constant nor frozen."""
    path = clean_log().external_jp[:, 1]
    (dead,) = validate_log(outside(1, np.full(N, path[0]))).errors
    assert dead.message == "joint 2 never changes while measured_jp moves."
    (frozen,) = validate_log(outside(1, np.where(np.arange(N) < 800, path, path[800]))).errors
    assert frozen.code == "joint_dead"
    assert "from row 801 on" in frozen.message
    coarse = np.round(path / 0.02) * 0.02  # an encoder of one degree stands between its steps
    assert not findings(outside(1, coarse), "joint_dead")


def test_a_dead_motor_encoder_of_one_joint_is_refused() -> None:
    """Its joint was "left uncorrected", with errors of nan; a motor that stands for a while may be braked."""
    table = clean_log().measured_jp.copy()
    table[:, 1] = table[0, 1]
    log = replace(clean_log(), measured_jp=table, tracker_cp=None, meta=LogMeta())
    with pytest.raises(LogError, match="joint 2 never changes while setpoint_jp moves"):
        refuse_misread(log, ("external_jp", "measured_jp"))
    table = clean_log().measured_jp.copy()
    table[800:, 1] = table[800, 1]
    (braked,) = findings(replace(log, measured_jp=table), "joint_dead")
    assert braked.severity == "warning"


@pytest.mark.parametrize("late", [-0.08, 0.08])
def test_one_late_encoder_is_named_by_how_much_it_is_late(late: float) -> None:
    """The delay of all joints together hardly changes; whoever fits is told, and a log without one is left in peace."""
    log = clean_log()
    path = log.external_jp[:, 1].copy()
    for _, rows in log.trajectories():
        path[rows] = np.interp(log.time[rows] - late, log.time[rows], path[rows])
    (found,) = refuse_misread(outside(1, path), ("external_jp", "measured_jp"))
    assert (found.code, found.signal) == ("joint_late", "external_jp")
    joint, size, word = re.match(r"joint (\d) is (\d+) ms (\w+)", found.message).groups()
    assert (joint, word) == ("2", "later" if late > 0 else "earlier")
    assert float(size) == pytest.approx(80.0, abs=10.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_joints_that_slack_delays_differently_are_not_called_late(seed: int) -> None:
    """Of short reaches each of six joints seems 50 to 120 ms beside the others; the demo records such ones."""
    assert not findings(debridement_log(seed, reaches=60), "joint_late")


def test_no_recorded_joint_is_called_late() -> None:
    """Wrists whose slack and noise hide their delay by 0.2 s are not judged."""
    for name in ("dvrk_pick_place.parquet", "dvrk_random.csv", "dvrk_wiggle_1.csv", "dvrk_wiggle_2.csv"):
        assert not validate_log(read_log(real_data(name)), ("joint_late",)).findings
