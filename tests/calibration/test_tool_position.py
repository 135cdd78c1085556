"""The position estimator: whole trajectories held out, streams as batches, files that survive, a real reduction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpcorrect.calibration import (
    Experiment,
    FitSettings,
    PositionEstimator,
    RobotState,
    evaluate_model,
    load,
    position_reductions,
    run_experiment,
    save,
)
from gpcorrect.calibration.joint_path import state_columns
from gpcorrect.errors import ArtifactError, DataError, LogError
from gpcorrect.report import write_fit_report
from gpcorrect.sim import preset, random_reaches_log
from gpcorrect.types import CalibrationLog

SEED = 406


@pytest.fixture(scope="module")
def log() -> CalibrationLog:
    """Return reaches of a simulated RAVEN-II whose tracker's frame is known by construction."""
    model = preset("raven2_left")
    assert model.T_tracker_base is not None
    frame = model.T_tracker_base
    log = random_reaches_log("raven2_left", 30, SEED, faults=False, model=model)
    return replace(log, meta=replace(log.meta, tracker_base=(*frame.translation, *frame.rotvec)))


def fit(log: CalibrationLog, **changes: object) -> Experiment:
    settings = FitSettings(**{"inducing": 60, "search_samples": 150, "time_offset": "none", **changes})  # type: ignore[arg-type]
    return run_experiment(log, settings, task=PositionEstimator)


@pytest.fixture(scope="module")
def fitted(log: CalibrationLog) -> Experiment:
    return fit(log)


def _sample(log: CalibrationLog, i: int) -> RobotState:
    return RobotState(
        float(log.time[i]),
        log.measured_jp[i],
        log.measured_cp.position[i],
        log.measured_cp.quaternion[i],
        log.setpoint_jp[i],
        log.measured_jv[i],
        log.measured_jf[i],
        log.setpoint_cp.position[i],
        log.setpoint_cp.quaternion[i],
    )


def test_the_error_on_held_out_reaches_falls_by_85_per_cent(fitted: Experiment) -> None:
    """Against what the robot reports; and well below what the best rigid motion leaves."""
    figures = position_reductions(fitted.evaluation)
    assert figures["rms_reduction"] > 85.0
    assert figures["estimated"]["rms_mm"] < 0.6 * figures["rigid"]["rms_mm"]


def test_held_out_reaches_are_whole_and_unseen(log: CalibrationLog, fitted: Experiment) -> None:
    """Other labels of the last fifth of the trajectories change nothing of the fit."""
    last = log.trajectory_ids[-6:]
    other = log.tracker_cp.position + np.where(np.isin(log.trajectory, last)[:, None], 3e-4, 0.0)
    changed = replace(log, tracker_cp=replace(log.tracker_cp, position=other))
    again = fit(changed).corrector
    np.testing.assert_array_equal(again.correct_log(log).position, fitted.corrector.correct_log(log).position)


@pytest.mark.parametrize("method", ["gp", "linear", "network"])
def test_a_stream_says_what_the_batch_says(log: CalibrationLog, method: str) -> None:
    """Sample after sample, slack remembered, the stream gives the batch's positions, deviations and reasons."""
    few = log.select(np.isin(log.trajectory, log.trajectory_ids[:12]))
    model: PositionEstimator = fit(few, method=method, layers=(8, 6), epochs=3, inducing=40).corrector
    batch, stream = model.correct_log(few), model.stream()
    for i in range(100):
        answer = stream.correct(_sample(few, i))
        np.testing.assert_allclose(answer.position, batch.position[i], atol=1e-9)
        np.testing.assert_allclose(answer.std, batch.std[i], atol=1e-9)
        assert answer.reasons == batch.reasons[i]


def test_a_model_file_answers_as_before(fitted: Experiment, log: CalibrationLog, tmp_path: Path) -> None:
    """Saved and loaded, the estimates are bit for bit the same; a cut file is refused."""
    save(fitted.corrector, tmp_path / "estimator.gpc")
    loaded = load(tmp_path / "estimator.gpc", PositionEstimator)
    np.testing.assert_array_equal(loaded.correct_log(log).position, fitted.corrector.correct_log(log).position)
    assert position_reductions(evaluate_model(loaded, log))["rms_reduction"] > 85.0
    (tmp_path / "cut.gpc").write_bytes((tmp_path / "estimator.gpc").read_bytes()[:-200])
    with pytest.raises(ArtifactError):
        load(tmp_path / "cut.gpc", PositionEstimator)


def test_far_outside_the_estimate_is_bounded_and_said_to_be_unknown(fitted: Experiment, log: CalibrationLog) -> None:
    """Five training ranges away the estimate stays within the largest error of the training."""
    model: PositionEstimator = fitted.corrector
    sample = _sample(log, 3)
    far = replace(sample, measured_jp=np.asarray(sample.measured_jp) + 10 * model.view.features.half)
    answer = model.stream().correct(far)
    assert not answer.in_domain
    limit = model.law.bounds.largest[0] + np.linalg.norm(model.law.zero)
    assert np.linalg.norm(answer.position - sample.measured_position) <= limit


def test_a_tool_reported_where_the_training_had_none_is_outside(fitted: Experiment, log: CalibrationLog) -> None:
    """A position in another frame beside joints that are known; the same positions by stream and by batch."""
    model: PositionEstimator = fitted.corrector
    moved = replace(log, measured_cp=replace(log.measured_cp, position=log.measured_cp.position + 0.3))
    assert model.stream().correct(_sample(log, 3)).in_domain
    assert not model.stream().correct(_sample(moved, 3)).in_domain
    assert model.correct_log(log).in_domain.mean() > 0.9
    assert not model.correct_log(moved).in_domain.any()
    keep = np.ones(len(log), dtype=bool)
    assert model.having_seen(moved, keep).correct_log(moved).in_domain.mean() > 0.9


@pytest.mark.parametrize("name", ["measured_jp", "measured_position", "measured_jf"])
@pytest.mark.parametrize("change", [lambda values: values + 1j, lambda values: [str(value) + "!" for value in values]])
def test_what_is_no_number_is_refused(fitted: Experiment, log: CalibrationLog, name: str, change: Any) -> None:
    """Complex numbers do not lose their imaginary part in silence, and text is named as what it is."""
    sample = _sample(log, 3)
    with pytest.raises(DataError, match="must be numbers"):
        fitted.corrector.stream().correct(replace(sample, **{name: change(getattr(sample, name))}))


def test_the_state_has_a_name_for_every_number(log: CalibrationLog) -> None:
    """54 numbers for six joints; extra columns come last, and must be there."""
    names, values = state_columns(log)
    assert len(names) == values.shape[1] == 54
    assert len(set(names)) == 54
    more = replace(log, extra={"motor_1": np.ones(len(log))})
    assert state_columns(more, ("motor_1",))[0][-1] == "motor_1_1"
    with pytest.raises(LogError, match="no column"):
        state_columns(log, ("motor_1",))


def test_poses_that_were_predicted_are_no_labels(log: CalibrationLog, fitted: Experiment) -> None:
    """Rows that a camera tracker coasted through are not learned from."""
    status = np.zeros(len(log))
    status[::2] = 1.0
    model: PositionEstimator = fitted.corrector
    samples = model.samples(replace(log, extra={"tracking_status": status}), np.ones(len(log), dtype=bool))
    assert not samples.usable[::2].any()
    assert samples.usable[1::2].any()


def test_what_cannot_be_learned_from_is_refused(log: CalibrationLog, fitted: Experiment) -> None:
    """No tracker, too few samples, a wrong method, and a stream that runs backwards."""
    with pytest.raises(LogError, match="tracker_cp"):
        fit(replace(log, tracker_cp=None))
    with pytest.raises((DataError, LogError), match=r"needed|at least"):
        fit(log.select(np.arange(15)))
    with pytest.raises(DataError, match="one of"):
        fit(log, method="forest")
    stream = fitted.corrector.stream()
    stream.correct(_sample(log, 5))
    with pytest.raises(DataError, match="advance"):
        stream.correct(_sample(log, 4))


def test_an_estimator_has_the_page_of_every_task(fitted: Experiment, tmp_path: Path) -> None:
    """The page lists every held-out reach and draws true, reported and estimated positions."""
    write_fit_report(fitted, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert page.count("data-key=") == len(fitted.test.trajectory_ids)
    assert "In space: true, reported, estimated." in page


def test_a_refused_sample_leaves_no_trace_in_a_stream(fitted: Experiment, log: CalibrationLog) -> None:
    """A missing joint, millimetres and degrees are refused, and the next sample is answered as if they had not come."""
    one, other = fitted.corrector.stream(), fitted.corrector.stream()
    assert log.measured_jp is not None
    for i in range(20):
        sample = _sample(log, i)
        gone = np.where(np.arange(6) == 1, np.nan, sample.measured_jp)
        millimetres = 1e3 * np.asarray(sample.measured_position)
        for bad, message in (
            (replace(sample, measured_jp=gone), "lacks a number"),
            (replace(sample, measured_position=millimetres), "reaches so far"),
            (replace(sample, measured_jp=np.rad2deg(np.asarray(sample.measured_jp))), "so far off"),
        ):
            with pytest.raises(DataError, match=message):
                one.correct(bad)
        np.testing.assert_array_equal(one.correct(sample).position, other.correct(sample).position)
    with pytest.raises(DataError, match="so far off"):
        fitted.corrector.correct_log(replace(log, measured_jp=np.rad2deg(log.measured_jp)))


def test_a_whole_state_of_other_signals_is_refused(log: CalibrationLog) -> None:
    """As many numbers, but efforts where velocities were: by their names they are told apart, in a log and a stream."""
    few = log.select(np.isin(log.trajectory, log.trajectory_ids[:12]))
    model = fit(replace(few, measured_jf=None), method="network", layers=(4,), epochs=2).corrector
    with pytest.raises(DataError, match="missing: measured_jv_1"):
        model.correct_log(replace(few, measured_jv=None))
    with pytest.raises(DataError, match="new: measured_jf_1"):
        model.stream().correct(replace(_sample(few, 0), measured_jv=None))
