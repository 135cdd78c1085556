"""Mechanical stops: found where there are some and nowhere else, and no joint is said to be beyond."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.calibration import FitResult, FitSettings, JointCorrector, evaluate_model, fit_model, load, save, stops
from gpcorrect.calibration.stops import Stops
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray

STOP = 0.405  # m; joint 3 is sent up to 0.42


def sent(seed: int) -> FloatArray:
    """Return joints on their way up and down, a thousand samples of three."""
    t = np.linspace(0, 60, 1000)[:, None]
    return np.sin(t * np.array([0.7, 1.1, 0.9]) + seed) * np.array([0.5, 0.8, 0.06])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_planted_stop_is_found(seed: int, side: float) -> None:
    """To a few deviations of the noise, on the side and the joint where it is, and no other."""
    q, noise = sent(seed), 2e-3 * np.random.default_rng(seed).standard_normal((1000, 3))
    ended = q + 0.01 + noise
    ended[:, 1] = side * np.minimum(side * q[:, 1], 0.75) + 0.01 + noise[:, 1]
    found = Stops.of(q, ended)
    assert found is not None
    place, others = (found.high, found.low) if side > 0 else (found.low, found.high)
    assert side * place[1] == pytest.approx(0.75, abs=4e-3)
    assert np.isinf(others).all()
    assert np.isinf(place[[0, 2]]).all()


@pytest.mark.parametrize("top", [0.5 * stops.TOP, 2.0 * stops.TOP])
def test_how_far_from_the_end_is_looked_matters_little(top: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half and double the part that is searched find the same stop."""
    monkeypatch.setattr(stops, "TOP", top)
    test_a_planted_stop_is_found(0, 1.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["noise", "slack", "stretch", "hung", "parked"])
def test_what_is_no_stop_is_none(seed: int, kind: str) -> None:
    """Noise, slack of two fifths of the range, a joint that gives way, a tracker that hung, a joint parked there."""
    q, rng = sent(seed), np.random.default_rng(seed)
    ended = q + 1e-3 * rng.standard_normal(q.shape)
    if kind == "slack":
        lag = np.zeros(3)
        for t in range(1, len(q)):
            lag = np.clip(lag + q[t] - q[t - 1], -0.2 * np.ptp(q, axis=0), 0.2 * np.ptp(q, axis=0))
            ended[t] -= lag
    elif kind == "stretch":
        ended -= 0.3 * np.maximum(q - 0.3, 0.0)
    elif kind == "hung":
        begin = int(np.argmax(q[:, 1])) - 8
        ended[begin : begin + 17] = ended[begin]
    elif kind == "parked":
        q = np.minimum(q, 0.04)
    assert Stops.of(q, ended) is None


def stopped(seed: int) -> CalibrationLog:
    log = joint_log(seed, trajectories=6)
    assert log.external_jp is not None
    truth = np.array(log.external_jp)
    truth[:, 2] = np.minimum(truth[:, 2], STOP)
    return replace(log, external_jp=truth)


@pytest.fixture(scope="module")
def learned() -> FitResult:
    return fit_model(stopped(0), FitSettings(inducing=60, search_samples=150, clean=False), task=JointCorrector)


def test_joints_end_at_their_stop(learned: FitResult, tmp_path: Path) -> None:
    """No answer is beyond, those nearby are as good as elsewhere, a stream and a file say the same, so does the fit."""
    log, corrector = stopped(1), learned.corrector
    answer = corrector.correct_log(log)
    beyond = log.measured_jp[:, 2] > STOP
    assert beyond.sum() > 20
    assert (answer.joints[:, 2] < STOP + 5e-4).all()
    assert np.abs(answer.joints - log.external_jp)[beyond, 2].max() < 1e-3
    far = corrector.correct_path(np.array([[0.7, 1.4, 0.9]]), np.zeros(1), np.zeros((1, 3)))
    assert far.joints[0, 2] < STOP + 2e-3
    save(corrector, tmp_path / "m.gpc")
    stream = load(tmp_path / "m.gpc", JointCorrector).stream()
    for i in range(80):
        one = stream.correct(float(log.time[i]), log.measured_jp[i], log.measured_jf[i])
        np.testing.assert_allclose(one.joints, answer.joints[i], atol=1e-9)
    (said,) = [remark for remark in learned.remarks if "joint 3 ends at 39" in remark]
    assert "mm of measured_jp" in said


def test_the_raw_error_is_what_was_logged(learned: FitResult) -> None:
    """What stands in a table as raw is the difference of the log's own signals, beyond the stop too."""
    log = stopped(1)
    raw = 1e3 * np.sqrt(np.mean((log.external_jp - log.measured_jp)[:, 2] ** 2))
    assert evaluate_model(learned.corrector, log).dirty_errors["raw"][2]["rmse"] == pytest.approx(raw, rel=1e-9)


def test_no_command_goes_beyond_a_stop() -> None:
    """A desired place beyond it is answered with the command that goes there, as are commands that went too far."""
    settings = FitSettings(
        inducing=60, search_samples=150, clean=False, direction="command", features=("position", "velocity", "memory")
    )
    corrector = fit_model(stopped(0), settings, task=JointCorrector).corrector
    assert corrector.view.stops.high[2] < 0.41
    answer = corrector.correct_path(np.array([[0.7, 1.4, 0.43]]), np.zeros(1))
    assert answer.joints[0, 2] < corrector.view.stops.high[2] + 2e-3
    near, beyond = (corrector.correct_path(np.array([[0.7, 1.4, q]]), np.zeros(1)) for q in (0.37, 0.408))
    assert (near.status, beyond.status) == (("OK",), ("EXTRAPOLATING",))


def test_stops_that_cannot_be_are_refused() -> None:
    """A forged file's stops leave room between them, and are as many as the joints."""
    with pytest.raises(DataError):
        Stops(np.array([0.2]), np.array([0.1]))
    with pytest.raises(DataError):
        Stops(np.array([np.nan]), np.array([0.1]))


def test_a_stop_far_inside_the_range_that_joints_were_sent_to_is_found() -> None:
    """A slide that was sent beyond its stop by a quarter of its range, in a third of the samples, ends there."""
    rng = np.random.default_rng(5)
    sent = 0.15 + 0.04 * np.sin(np.linspace(0.0, 60.0, 3000))[:, None]
    ended = np.minimum(sent + 4e-4 * np.sin(200.0 * sent), 0.168) + 2e-5 * rng.standard_normal(sent.shape)
    stops = Stops.of(sent, ended)
    assert stops is not None
    assert stops.high[0] == pytest.approx(0.168, abs=1e-3)
    assert not np.isfinite(stops.low[0])
