"""What a failing outside sensor must not do to the path that commands are learned from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gpcorrect.calibration import FitSettings, JointCorrector, fit_model
from gpcorrect.calibration.joint_path import without_faults
from gpcorrect.play import play_states
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta

SETTINGS = FitSettings(direction="command", inducing=60, search_samples=200)


def late_log(seed: int, trajectories: int) -> CalibrationLog:
    """Return a log at 50 Hz of two joints that follow their commands as servos of 60 ms do, through slack."""
    rng, step, lag, slack = np.random.default_rng(seed), 0.02, 0.06, 0.01
    time = np.arange(trajectories * 400) * step
    rates = rng.uniform(0.5, 4.0, (4, 2))
    sent = 0.15 * np.sin(rates * time[:, None, None] + rng.uniform(0, 2 * np.pi, (4, 2))).sum(axis=1)
    motor = np.empty_like(sent)
    motor[0] = sent[0]
    for k in range(1, len(sent)):
        motor[k] = motor[k - 1] + (1 - np.exp(-step / lag)) * (sent[k] - motor[k - 1])
    steps = np.diff(motor, axis=0, prepend=motor[:1])
    seen = motor - play_states(steps, np.full((1, 2), slack), np.zeros(len(sent), dtype=np.int64))[:, 0]
    return CalibrationLog(
        time=time,
        trajectory=np.arange(len(time)) // 400,
        session=np.zeros(len(time)),
        setpoint_jp=sent,
        external_jp=seen + 3e-4 * rng.standard_normal(seen.shape),
        meta=LogMeta(joint_types="RR"),
    )


def outliers(seen: FloatArray) -> FloatArray:
    """Return outside joints of which one sample in two hundred is wrong by a sixth of the range."""
    rng, wrong = np.random.default_rng(3), seen.copy()
    rows = rng.choice(len(seen), len(seen) // 200, replace=False)
    wrong[rows] += rng.choice([-1.0, 1.0], (len(rows), 2)) / 6 * np.ptp(seen, axis=0)
    return wrong


def every_third(seen: FloatArray) -> FloatArray:
    """Return outside joints of a sensor at a third of the log's rate."""
    return np.where((np.arange(len(seen)) % 3 == 0)[:, None], seen, np.nan)


def missed(training: CalibrationLog) -> FloatArray:
    """Return the errors (2,) of the commands that a log teaches, on another one without faults."""
    model = fit_model(training, SETTINGS, task=JointCorrector).corrector
    log = late_log(1, 3)
    return np.sqrt(np.mean(np.square(model.correct_log(log).joints - log.setpoint_jp), axis=0))


@pytest.fixture(scope="module")
def clean() -> FloatArray:
    """Return what a sensor without faults leaves."""
    return missed(late_log(0, 10))


@pytest.mark.parametrize("fault", [outliers, every_third])
def test_a_sensors_faults_move_no_slack(fault: Callable[[FloatArray], FloatArray], clean: FloatArray) -> None:
    """They moved velocities and slacks of what follows: commands were off by up to 2.5 and 6.9 times as much."""
    log = late_log(0, 10)
    assert (missed(replace(log, external_jp=fault(log.external_jp))) < 1.3 * clean).all()


def test_a_rejected_place_that_the_arm_can_have_reached_is_passed() -> None:
    """An arm that a stop holds is rejected for its error; what a sensor invents lies off by more than was travelled."""
    time, one = np.arange(6.0), np.zeros(6, dtype=np.int64)
    sent = np.array([0.0, 0.2, 0.4, 0.2, 0.0, 0.01])[:, None]
    seen = sent + np.array([0.01, 0.01, -0.1, 0.01, 0.01, 0.01])[:, None]
    log = CalibrationLog(time, one, one, setpoint_jp=sent, external_jp=seen)
    stopped = without_faults(log, seen, sent, np.arange(6) != 2)
    np.testing.assert_array_equal(stopped, seen)
    invented = seen.copy()
    invented[4] += 0.5
    np.testing.assert_allclose(without_faults(log, invented, sent, np.arange(6) != 4), seen, atol=1e-12)


def test_after_a_long_loss_a_path_begins_anew() -> None:
    """Over more than a pause nobody knows where the arm went."""
    time, one = np.arange(100.0), np.zeros(100, dtype=np.int64)
    sent = np.sin(time)[:, None]
    seen = np.where(((time > 20) & (time < 60))[:, None], np.nan, sent)
    path = without_faults(CalibrationLog(time, one, one, setpoint_jp=sent, external_jp=seen), seen, sent, one == 0)
    assert np.isnan(path[21:60]).all()
    assert np.isfinite(path[[20, 60]]).all()
