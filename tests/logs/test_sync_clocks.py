"""Laws of the one clock rule: the robot's own lag and play are left alone, a shift is right and never silent."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sync_support import one_run, wandering

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import align, match_clocks
from gpcorrect.logs.sync import clocks as clocks_of
from gpcorrect.sim import random_reaches_log
from gpcorrect.sim.effects import play
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

N, RATE = 1000, 50.0


def joints(external: FloatArray, measured: FloatArray, rate: float) -> CalibrationLog:
    return one_run(np.arange(len(measured)) / rate, measured_jp=measured, external_jp=external)


def poses(lag: float, rng: np.random.Generator) -> CalibrationLog:
    """Return a log of 20 s whose tracker runs `lag` s behind the commands, and ahead of what is reported by as much."""
    t, path = np.arange(N) / RATE, wandering(rng)
    seen = PoseSignal(path(t - lag) + 1e-4 * rng.normal(size=(N, 3)))
    command = PoseSignal(path(t))
    return one_run(t, setpoint_cp=command, measured_cp=command, tracker_cp=seen)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("reference", ["setpoint_cp", "measured_cp"])
@pytest.mark.parametrize("lag", [0.4, -0.3])
def test_a_clock_that_no_servo_explains_is_shifted_and_reported(reference, lag, rng):
    log, clocks = match_clocks(poses(lag, rng), "tracker_cp", reference, "auto")
    assert clocks.applied == pytest.approx(lag, abs=2e-3)
    assert "was shifted" in clocks.remark
    assert np.nanmax(np.abs(log.tracker_cp.position - log.setpoint_cp.position)) < 1e-3


def test_a_lag_of_the_robot_is_left_alone_and_reported(rng, monkeypatch):
    log = poses(0.08, rng)
    same, clocks = match_clocks(log, "tracker_cp", "setpoint_cp", "auto")
    assert same is log
    assert clocks.applied == 0.0
    assert clocks.offset.offset == pytest.approx(0.08, abs=2e-3)
    assert "80" in clocks.remark
    monkeypatch.setattr(clocks_of, "PLAUSIBLE_LAG", (0.0, 0.02))
    assert match_clocks(log, "tracker_cp", "setpoint_cp", "auto")[1].applied > 0.0


def test_play_in_the_drive_is_not_taken_for_a_clock():
    """Slow joints with play are late at reversals, by more than a servo is; a clock is late throughout."""
    rng = np.random.default_rng(2)
    motor = 10 * wandering(rng)(np.arange(4000) / 150.0)
    log = joints(play(motor, 0.04 * np.ptp(motor)), motor, RATE)
    same, clocks = match_clocks(log, "external_jp", "measured_jp", "auto")
    assert clocks.offset.offset == pytest.approx(0.0, abs=5e-3)  # 80 ms, if play is not looked for
    assert same is log
    late = align(replace(log, external_jp=motor), -0.4, signals=("external_jp",))
    assert match_clocks(late, "external_jp", "measured_jp", "auto")[1].applied == pytest.approx(0.4, abs=0.01)


@cache
def few_reaches(seed: int, n: int) -> CalibrationLog:
    return random_reaches_log(seed=seed, n_trajectories=n)


@pytest.mark.parametrize(("seed", "n"), [(3, 2), (5, 2), (6, 2), (1, 3), (5, 3)])
@pytest.mark.parametrize("planted", [0.0, 0.8, -1.2])
def test_few_reaches_never_shift_wrongly(seed, n, planted):
    """With two or three reaches either nothing is applied, or the planted offset and the robot's lag of 40 ms."""
    log = align(few_reaches(seed, n), -planted) if planted else few_reaches(seed, n)
    clocks = match_clocks(log, "tracker_cp", "setpoint_cp", "auto")[1]
    assert clocks.applied == 0.0 or clocks.applied == pytest.approx(planted + 0.04, abs=0.05)
    assert planted or clocks.applied == 0.0


def test_seconds_and_none_do_as_they_say(rng):
    log = poses(0.1, rng)
    assert match_clocks(log, "tracker_cp", "setpoint_cp", "none")[0] is log
    shifted, clocks = match_clocks(log, "tracker_cp", "setpoint_cp", "0.1")
    assert clocks.applied == 0.1
    assert "0.1 s that were given" in clocks.remark
    assert np.nanmax(np.abs(shifted.tracker_cp.position - log.setpoint_cp.position)) < 1e-3
    with pytest.raises(DataError, match="auto, none, or a number of seconds"):
        match_clocks(log, "tracker_cp", "setpoint_cp", "soon")
    with pytest.raises(LogError, match="no external_jp"):
        match_clocks(log, "external_jp", "measured_jp", "auto")


def test_static_poses_have_no_clock(rng):
    log = replace(poses(0.4, rng), static=True, trajectory=np.arange(N))
    same, clocks = match_clocks(log, "tracker_cp", "setpoint_cp", "auto")
    assert same is log
    assert "no clock" in clocks.remark
    with pytest.raises(LogError, match="no clock to shift"):
        match_clocks(log, "tracker_cp", "setpoint_cp", "0.1")


def test_a_clock_that_drifts_within_a_plausible_lag_is_said():
    """Nothing is shifted, and a person hears of the drift; of a lag that stays as it is nobody does."""
    rng = np.random.default_rng(3)
    path, time = wandering(rng), np.arange(0, 120, 0.02)
    for ppm, said in ((0.0, False), (200.0, True)):
        seen = path((time - 0.05) * (1 - 1e-6 * ppm)) + 5e-5 * rng.normal(size=(len(time), 3))
        log = one_run(time, setpoint_cp=PoseSignal(path(time)), tracker_cp=PoseSignal(seen))
        same, clocks = match_clocks(log, "tracker_cp", "setpoint_cp", "auto")
        assert same is log
        assert clocks.to_note == said
        assert ("ppm against theirs" in clocks.remark) == said


def test_a_sensor_behind_what_is_reported_is_said(rng):
    """Of a lag behind the commands nobody need hear; behind the reported pose it may be a camera's delay."""
    log = poses(0.05, rng)
    for told, said in ((log, True), (replace(log, measured_cp=None), False)):
        same, clocks = match_clocks(told, "tracker_cp", "setpoint_cp", "auto")
        assert same is told
        assert clocks.to_note == said
    assert not match_clocks(poses(0.0, rng), "tracker_cp", "measured_cp", "auto")[1].to_note
