"""What a lab's logs hold besides clean motion: an unknown start in the slack, doubled stamps, other columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.calibration import FitSettings, JointCorrector, PositionEstimator, fit_model
from gpcorrect.calibration.memory import lag_step
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog, PoseSignal

PAST = ("position", "velocity", "acceleration", "memory", "lags")


@pytest.fixture(scope="module")
def log() -> CalibrationLog:
    """Return eight motions of three joints with slack."""
    return joint_log(0, 8, 20.0)


@pytest.fixture(scope="module")
def with_memory(log: CalibrationLog) -> JointCorrector:
    """Return a linear law that looks at the past."""
    settings = FitSettings(method="linear", features=PAST, clean=False)
    model: JointCorrector = fit_model(log, settings, task=JointCorrector).corrector
    return model


def test_intervals_hold_where_the_slack_is_not_known_yet(with_memory: JointCorrector) -> None:
    """Paths that begin anywhere in the slack are covered from the first sample on, batch and stream alike."""
    other = joint_log(5, 3, 20.0)
    assert other.measured_jp is not None
    assert other.external_jp is not None
    inside, wide = [], []
    for first in range(20, 500, 20):
        part = other.select(slice(first, first + 60))
        answer = with_memory.correct_log(part)
        stream = with_memory.stream()
        live = np.array([stream.correct(t, q).interval95 for t, q in zip(part.time, part.measured_jp, strict=True)])
        np.testing.assert_allclose(live, answer.interval95, rtol=1e-9, atol=1e-12)
        inside.append(np.abs(answer.joints - part.external_jp) <= answer.interval95)
        wide.append(answer.interval95)
    first, last = (np.median([rows[k] for rows in wide], axis=0) for k in (0, -1))
    assert np.mean([rows[:6] for rows in inside]) > 0.95
    assert (first > 1.5 * last).all()  # and what is known is not left wide
    settled = with_memory.correct_path(part.measured_jp, part.time, from_middle=True).interval95
    assert (settled[0] < 1.01 * last).all()


def test_one_stamp_twice_is_a_step_without_time(log: CalibrationLog, with_memory: JointCorrector) -> None:
    """Lags move on by the whole step, as in a nanosecond, and a log with such stamps is answered."""
    behind, moved, constants = np.array([[0.1, -0.2]]), np.array([0.3, 0.1]), np.array([2.0])
    one, other = (lag_step(behind, moved, step, constants) for step in (0.0, 1e-9))
    np.testing.assert_allclose(one, other, atol=1e-8)
    doubled = np.array(log.time)
    doubled[40] = doubled[39]
    assert np.isfinite(with_memory.correct_log(replace(log, time=doubled)).interval95).all()


def test_a_log_of_fewer_joints_is_refused(log: CalibrationLog, with_memory: JointCorrector) -> None:
    """A model of three joints says so to a log of two, or of four."""
    for columns in ([0, 1], [0, 1, 2, 2]):
        names = ("measured_jp", "measured_jf", "external_jp")
        other = replace(log, **{name: getattr(log, name)[:, columns] for name in names})
        other = replace(other, meta=replace(log.meta, joint_types="RRPP"[: len(columns)]))
        for ask in (with_memory.clean, with_memory.clean_afresh, with_memory.correct_log):
            with pytest.raises(DataError, match="the model knows 3 joints"):
                ask(other)


@pytest.mark.parametrize("columns", [[0, 1], [0, 0, 1, 2]])
@pytest.mark.parametrize("task", [JointCorrector, PositionEstimator])
def test_efforts_of_other_joints_are_refused(
    log: CalibrationLog, task: type[JointCorrector | PositionEstimator], columns: list[int]
) -> None:
    """Of more or fewer efforts than joints nobody knows which joint's they are."""
    assert log.measured_jp is not None
    seen = PoseSignal(log.measured_jp)
    other = replace(log, measured_jf=log.measured_jf[:, columns], measured_cp=seen, tracker_cp=seen)
    with pytest.raises(LogError, match="measured_jf has"):
        fit_model(other, FitSettings(method="linear", clean=False), task=task)


def test_efforts_that_are_mostly_missing_are_no_default(log: CalibrationLog) -> None:
    """A joint without efforts, or a logger that lost them, costs the efforts and not the fit."""
    assert log.measured_jf is not None
    for rows, joints in ((slice(None), 1), (slice(5, None), slice(None))):
        efforts = np.array(log.measured_jf)
        efforts[rows, joints] = np.nan
        result = fit_model(replace(log, measured_jf=efforts), FitSettings(method="linear"), task=JointCorrector)
        assert result.corrector.view.features.kinds == ("position",)


@pytest.mark.filterwarnings("error")
def test_a_recording_without_any_error_needs_no_warning(log: CalibrationLog) -> None:
    """Truth that repeats what was reported, as a column mapped twice does, gives a model without numpy's warnings."""
    result = fit_model(replace(log, external_jp=log.measured_jp), FitSettings(method="linear"), task=JointCorrector)
    measured = result.corrector.measure(log, np.ones(len(log), dtype=bool))
    assert np.isfinite(measured.raw).all()
    assert len(measured.scores) == 0


@pytest.mark.parametrize(
    "wrong",
    [{"direction": "commands"}, {"input_signal": "measured"}, {"layers": (0,)}, {"epochs": 0}, {"inducing": -5}],
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, object]) -> None:
    """A direction that is none was taken for "command"."""
    with pytest.raises(DataError, match=next(iter(wrong))):
        FitSettings(**wrong)  # type: ignore[arg-type]


def test_sessions_are_told_apart_by_any_number(with_memory: JointCorrector, log: CalibrationLog) -> None:
    """Sessions .2 and .9 are two, and words are refused."""
    part, time = log.measured_jp[:40], log.time[:40]
    half = np.arange(40) < 20
    whole, other = (
        with_memory.correct_path(part, time, sessions=np.where(half, *pair)).joints for pair in ((0, 1), (0.2, 0.9))
    )
    np.testing.assert_array_equal(whole, other)
    with pytest.raises(DataError, match="sessions must be numbers"):
        with_memory.correct_path(part, time, sessions=["a"] * 40)
