"""Calibrators, data sets, model files, zeros."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log
from sklearn.utils.estimator_checks import check_estimator
from support import real_data

from gpcorrect.errors import ArtifactError, DataError, DegenerateError, LogError
from gpcorrect.joint import NetworkCalibrator, PolynomialCalibrator, joint_data
from gpcorrect.joint_artifact import load_joint, save_joint
from gpcorrect.joint_corrector import METHODS, JointExperiment, JointSettings, Method, fit_joint
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog

LOG = joint_log(1, trajectories=6)


def fitted(method: Method, log: CalibrationLog = LOG) -> JointExperiment:
    return fit_joint(log, JointSettings(method=method, inducing=100))


def rmse(experiment: JointExperiment, name: str = "corrected") -> np.ndarray:
    return np.array([row["rmse"] for row in experiment.errors[name]], dtype=np.float64)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_polynomials_keep_the_contract_of_estimators(degree: int) -> None:
    """scikit-learn's own checks pass; an offset alone need not score."""
    expected = {"check_regressors_train": "an offset explains nothing"} if degree == 0 else {}
    check_estimator(PolynomialCalibrator(degree), expected_failed_checks=expected)


def test_network_map_is_the_network_of_scikit_learn() -> None:
    """A small network learns a smooth function, and keeps no state beyond its numbers."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (500, 2))
    y = np.column_stack([np.sin(2 * X[:, 0]), X[:, 1]])
    network = NetworkCalibrator((30,), epochs=400, batch=50).fit(X, y)
    assert network.score(X, y) > 0.95


@pytest.mark.parametrize("method", METHODS)
def test_a_saved_model_answers_as_before(method: Method, tmp_path: Path) -> None:
    """Every method is no worse than the fixed offset, and its file gives the same estimates to the last bit."""
    experiment = fitted(method)
    assert (rmse(experiment) <= 1.02 * rmse(experiment, "fixed_offset")).all()
    save_joint(experiment.corrector, tmp_path / "m.gpc")
    again = load_joint(tmp_path / "m.gpc")
    data = joint_data(LOG)
    np.testing.assert_array_equal(again.estimate(data).q, experiment.corrector.estimate(data).q)


def test_memory_finds_what_the_polynomials_cannot() -> None:
    """Without efforts, slack is seen by the regression with memory only."""
    log = replace(LOG, measured_jf=None)
    assert (rmse(fitted("gp", log)) < 0.4 * rmse(fitted("quadratic", log))).all()


def test_commands_lead_to_the_desired_joints() -> None:
    """In the other direction, what to command for a desired true position is learned as well."""
    log = replace(joint_log(1, trajectories=10), measured_jf=None)
    back = fit_joint(log, JointSettings(method="linear", direction="command"))
    assert (rmse(back) < 0.7 * rmse(back, "raw")).all()
    with pytest.raises(DataError, match="effort"):
        fit_joint(LOG, JointSettings(method="linear", direction="command", features=("position", "effort")))


def test_a_short_run_sets_a_new_zero() -> None:
    """After a homing that moved joint 2, one minute brings the errors back, and says which joint moved."""
    corrector = fitted("gp").corrector
    after = joint_log(2, trajectories=2, shift=0.02)
    moved = corrector.moved(after)
    assert moved[1] == pytest.approx(0.02, abs=0.003)
    fresh = corrector.rezeroed(after)
    other = joint_log(3, trajectories=2, shift=0.02)
    data = joint_data(other)
    assert data.truth is not None
    left = [np.abs(data.truth - c.estimate(data).q)[:, 1].mean() for c in (corrector, fresh)]
    assert left[1] < 0.3 * left[0]


def test_bad_logs_are_named() -> None:
    """A still joint, millimetres, a missing signal, no efforts: each is refused with its reason."""
    q, truth = np.array(LOG.measured_jp), np.array(LOG.external_jp)
    still = q.copy()
    still[:, 1] = 1.0
    with pytest.raises(DegenerateError, match="joint 2 never moves"):
        fitted("linear", replace(LOG, measured_jp=still))
    with pytest.raises(LogError, match="mm"):
        fitted("linear", replace(LOG, measured_jp=q * np.array([1, 1, 1e3])))
    with pytest.raises(LogError, match="external_jp"):
        fitted("linear", replace(LOG, external_jp=None))
    with pytest.raises(LogError, match="joints"):
        fitted("linear", replace(LOG, external_jp=truth[:, :2]))
    with pytest.raises(DataError, match="measured_jf"):
        fit_joint(replace(LOG, measured_jf=None), JointSettings(method="linear", features=("position", "effort")))


def test_missing_numbers_are_passed_over() -> None:
    """Samples without input or effort leave their estimate empty or predicted, never the whole path."""
    few = joint_log(1, trajectories=3)
    effort = np.array(few.measured_jf)
    effort[::7] = np.nan
    q = np.array(few.measured_jp)
    q[100:110] = np.nan
    log = replace(few, measured_jf=effort, measured_jp=q)
    for method in ("ukf", "gp"):
        experiment = fitted(method, log)  # type: ignore[arg-type]
        estimate = experiment.corrector.estimate(joint_data(log)).q
        assert np.isfinite(estimate[120:140][1:]).any()
        assert np.isfinite(rmse(experiment)).all()


def test_a_pose_model_is_no_joint_model(tmp_path: Path) -> None:
    """Another file is refused with the reason."""
    (tmp_path / "m.gpc").write_bytes(b"nothing")
    with pytest.raises(ArtifactError, match="refused"):
        load_joint(tmp_path / "m.gpc")


@pytest.mark.slow
def test_real_wrist_is_better_than_every_reference() -> None:
    """On a real arm, last fifth held out, every joint beats linear models with history and a plain regression."""
    log = read_log(real_data("dvrk_random.csv"))
    found = rmse(fit_joint(log, JointSettings(method="gp")))
    assert (found < np.array([0.042, 0.035, 0.110, 1.36, 3.5, 2.5])).all()
