"""The position estimator: whole trajectories held out, streams as batches, files that survive, a real reduction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpcorrect.errors import ArtifactError, DataError, LogError
from gpcorrect.estimator import (
    EstimatorExperiment,
    EstimatorSettings,
    PositionEstimator,
    RobotState,
    estimator_data,
    evaluate_estimator,
    fit_estimator,
    state_columns,
)
from gpcorrect.estimator_artifact import load_estimator, save_estimator
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


@pytest.fixture(scope="module")
def fitted(log: CalibrationLog) -> EstimatorExperiment:
    return fit_estimator(log, EstimatorSettings("gp", inducing=60))


def _sample(log: CalibrationLog, i: int) -> RobotState:
    assert log.measured_jp is not None
    assert log.measured_cp is not None
    assert log.measured_cp.quaternion is not None
    assert log.setpoint_cp is not None
    assert log.setpoint_cp.quaternion is not None
    assert log.setpoint_jp is not None
    assert log.measured_jv is not None
    assert log.measured_jf is not None
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


def test_the_error_on_held_out_reaches_falls_by_85_per_cent(fitted: EstimatorExperiment) -> None:
    """Against what the robot reports; and well below what the best rigid motion leaves."""
    assert fitted.errors["rms_reduction"] > 85.0
    assert fitted.errors["estimated"]["rms_mm"] < 0.6 * fitted.errors["rigid"]["rms_mm"]


def test_held_out_reaches_are_whole_and_unseen(log: CalibrationLog, fitted: EstimatorExperiment) -> None:
    """Labels of the last fifth of the trajectories may be anything: the fit stays the same."""
    last = log.trajectory_ids[-6:]
    assert log.tracker_cp is not None
    nonsense = np.where(np.isin(log.trajectory, last)[:, None], 1.0, log.tracker_cp.position)
    changed = replace(log, tracker_cp=replace(log.tracker_cp, position=nonsense))
    again = fit_estimator(changed, EstimatorSettings("gp", inducing=60)).estimator
    data = estimator_data(log)
    assert np.array_equal(again.estimate(data).position, fitted.estimator.estimate(data).position)


@pytest.mark.parametrize("method", ["gp", "linear", "network"])
def test_a_stream_says_what_the_batch_says(log: CalibrationLog, method: str) -> None:
    """Sample after sample, slack remembered, the stream gives the batch's positions and standard deviations."""
    settings = EstimatorSettings(method, layers=(8, 6), epochs=3, inducing=40)  # type: ignore[arg-type]
    few = log.select(np.isin(log.trajectory, log.trajectory_ids[:12]))
    model = fit_estimator(few, settings).estimator
    data = estimator_data(few)
    batch, stream = model.estimate(data), model.stream()
    end = int(np.flatnonzero(data.new)[1])
    for i in range(min(end, 150)):
        position, std = stream.predict(_sample(few, i))
        assert np.allclose(position, batch.position[i], atol=1e-9)
        assert np.allclose(std, batch.std[i], atol=1e-9)
    assert min(end, 150) > 20


def test_a_model_file_answers_as_before(fitted: EstimatorExperiment, log: CalibrationLog, tmp_path: Path) -> None:
    """Saved and loaded, the estimates are bit for bit the same; a file of another kind is refused."""
    save_estimator(fitted.estimator, tmp_path / "estimator.gpc")
    loaded: PositionEstimator = load_estimator(tmp_path / "estimator.gpc")
    data = estimator_data(log)
    assert np.array_equal(loaded.estimate(data).position, fitted.estimator.estimate(data).position)
    assert evaluate_estimator(loaded, log)["rms_reduction"] > 85.0
    (tmp_path / "cut.gpc").write_bytes((tmp_path / "estimator.gpc").read_bytes()[:-200])
    with pytest.raises(ArtifactError):
        load_estimator(tmp_path / "cut.gpc")


def test_the_state_has_a_name_for_every_number(log: CalibrationLog) -> None:
    """54 numbers for six joints; extra columns come last, and must be there."""
    names, values = state_columns(log)
    assert len(names) == values.shape[1] == 54
    assert len(set(names)) == 54
    more = replace(log, extra={"motor_1": np.ones(len(log))})
    assert state_columns(more, ("motor_1",))[0][-1] == "motor_1_1"
    with pytest.raises(LogError, match="no column"):
        state_columns(log, ("motor_1",))


def test_poses_that_were_predicted_are_no_labels(log: CalibrationLog) -> None:
    """Rows that a camera tracker coasted through are not learned from."""
    status = np.zeros(len(log))
    status[::2] = 1.0
    data = estimator_data(replace(log, extra={"tracking_status": status}))
    assert not data.usable[::2].any()
    assert data.usable[1::2].any()


def test_what_cannot_be_learned_from_is_refused(log: CalibrationLog, fitted: EstimatorExperiment) -> None:
    """No tracker, one trajectory, too few samples, a wrong method, and a stream that runs backwards."""
    with pytest.raises(LogError, match="tracker_cp"):
        fit_estimator(replace(log, tracker_cp=None))
    with pytest.raises(LogError, match="held out"):
        fit_estimator(log.select(log.trajectory == log.trajectory[0]))
    with pytest.raises(DataError, match="at least 50"):
        fit_estimator(log.select(np.arange(40)), EstimatorSettings(holdout=0.0))
    with pytest.raises(DataError, match="one of"):
        fit_estimator(log, EstimatorSettings("forest"))  # type: ignore[arg-type]
    stream = fitted.estimator.stream()
    stream.predict(_sample(log, 5))
    with pytest.raises(DataError, match="order of time"):
        stream.predict(_sample(log, 4))
