"""Joint calibration: every learner, both directions, zeros, files, bad logs, and answers far outside."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log
from support import few_trees, real_data

from gpcorrect.calibration import (
    LEARNERS,
    Experiment,
    FitSettings,
    HoldOut,
    JointCorrector,
    load,
    run_experiment,
    save,
)
from gpcorrect.calibration.dataset import Layout
from gpcorrect.calibration.learners.gp import _left_out
from gpcorrect.calibration.learners.network import NetworkMap
from gpcorrect.calibration.learners.polynomial import PolynomialMap, Scaler
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.gpr import SparseGPR
from gpcorrect.gpr.statistics import collected
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, FloatArray

pytestmark = pytest.mark.slow
LOG = joint_log(1, trajectories=6)


@cache
def fitted(method: str) -> Experiment:
    """Return each method's experiment on the shared recording, done once."""
    return fitted_to(LOG, method)


def fitted_to(log: CalibrationLog, method: str, **changes: object) -> Experiment:
    few: dict[str, object] = {"inducing": 100, "search_samples": 150, "epochs": 60}
    settings = FitSettings(method=method, **few, **changes)  # type: ignore[arg-type]
    with few_trees():
        return run_experiment(log, settings, task=JointCorrector)


def rmse(experiment: Experiment, name: str = "corrected") -> FloatArray:
    return np.array([row["rmse"] for row in experiment.evaluation.dirty_errors[name]], dtype=np.float64)


def test_a_linear_law_says_the_same_of_inputs_scaled_otherwise() -> None:
    """Its weights under another scaler give the same means."""
    rng = np.random.default_rng(0)
    X, Y = rng.normal(2.0, 3.0, (40, 3)), rng.normal(size=(40, 2))
    law, scaler = PolynomialMap.fit(X[:20], Y[:20], 1), Scaler.of(X)
    terms = np.column_stack([np.ones(len(X)), scaler.apply(X)])
    np.testing.assert_allclose(terms @ law.weights_under(scaler), law.mean(X), atol=1e-12)


def test_left_out_predictions_are_those_of_law_and_regression_of_the_other_folds() -> None:
    """Sums over folds, of targets and of the law's terms, give what a fit to the other folds' samples gives."""
    rng = np.random.default_rng(1)
    X, folds = rng.normal(size=(120, 3)), np.arange(120) // 30
    Y = X @ rng.normal(size=(3, 2)) + np.sin(2 * X[:, :2]) + 0.1 * rng.normal(size=(120, 2))
    layout = Layout((1, 1), None, np.array([0, 1]), np.full((3, 2), 1e-6), np.zeros(3), 40, np.zeros(0, dtype=np.int64))
    linear = PolynomialMap.fit(X, Y, 1, layout.penalties)
    regressor = SparseGPR(40, 20, output_groups=(1, 1))
    regressor.fit_by_parts(
        X[:, :2], Y - linear.mean(X), folds, np.column_stack([np.ones(len(X)), linear.scaler.apply(X)])
    )
    left_out, of_law = _left_out(regressor, linear, X, Y, layout, folds)
    out = folds == 2
    law = PolynomialMap.fit(X[~out], Y[~out], 1, layout.penalties)
    others = collected(regressor.points_, X[~out, :2], Y[~out] - law.mean(X[~out]))
    mean, std, _ = regressor.resting_on(others).predictor_.mean_std_batch(X[out, :2])
    np.testing.assert_allclose(of_law[out], Y[out] - law.mean(X[out]), atol=1e-12)
    np.testing.assert_allclose(left_out.errors[out], of_law[out] - mean, atol=1e-8)
    np.testing.assert_allclose(left_out.std[out], std, rtol=1e-6)  # rounding depends on the machine


def test_a_network_learns_a_smooth_function() -> None:
    """A small network explains 95 % of a sine and a line."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (500, 2))
    Y = np.column_stack([np.sin(2 * X[:, 0]), X[:, 1]])
    left = Y - NetworkMap.fit(X, Y, (30,), 2000, 0).predict(X)[0]
    assert (left.var(axis=0) < 0.05 * Y.var(axis=0)).all()


@pytest.mark.parametrize("method", LEARNERS)
def test_a_saved_model_answers_as_before(method: str, tmp_path: Path) -> None:
    """Every method is no worse than the fixed offset, and its file gives the same answers to the last bit."""
    experiment = fitted(method)
    assert (rmse(experiment) <= 1.02 * rmse(experiment, "fixed_offset")).all()
    save(experiment.corrector, tmp_path / "m.gpc")
    again = load(tmp_path / "m.gpc", JointCorrector).correct_log(LOG)
    before = experiment.corrector.correct_log(LOG)
    for name in ("joints", "std", "interval95", "reasons"):
        np.testing.assert_array_equal(getattr(again, name), getattr(before, name))


@pytest.mark.parametrize("method", LEARNERS)
def test_far_outside_every_answer_is_bounded_and_said_to_be_unknown(method: str) -> None:
    """Of queries 1 to 8 training ranges outside, none is in domain and none corrects more than training justifies.

    Nor is any surer than without a correction, or less sure than a few times the largest error that was ever seen.
    """
    corrector: JointCorrector = fitted(method).corrector
    rng = np.random.default_rng(0)
    centre, half = corrector.view.features.centre, corrector.view.features.half
    q = centre + half * rng.uniform(-1, 1, (300, 3))
    raw = np.abs(np.array(LOG.external_jp) - np.array(LOG.measured_jp))
    joint = rng.integers(0, 3, 300)
    away = half[joint] * (1 + 2 * 10 ** rng.uniform(0, 0.9, 300)) * rng.choice([-1, 1], 300)
    q[np.arange(300), joint] = centre[joint] + away
    alone = [corrector.correct_path(row[None], [0.0], np.zeros((1, 3))) for row in q]
    stream = [corrector.stream().correct(0.0, row, np.zeros(3)) for row in q]
    for path, live, row in zip(alone, stream, q, strict=True):
        assert not path.in_domain[0]
        assert not live.in_domain
        limit = corrector.law.bounds.largest + np.abs(corrector.law.zero) + 1e-12
        assert (np.abs(path.joints[0] - row) <= limit).all()
        assert (np.abs(live.joints - row) <= limit).all()
        assert (live.interval95 > 1.2 * np.sqrt((raw**2).mean(axis=0))).all()
        assert (live.interval95 < 4.0 * raw.max(axis=0)).all()


def test_memory_finds_what_the_polynomials_cannot() -> None:
    """Without efforts, slack is seen by the regression with memory only."""
    log = replace(LOG, measured_jf=None)
    assert (rmse(fitted_to(log, "gp")) < 0.4 * rmse(fitted_to(log, "quadratic"))).all()


def test_commands_lead_to_the_desired_joints() -> None:
    """In the other direction, what to command for a desired true position is learned as well."""
    log = replace(joint_log(1, trajectories=10), measured_jf=None)
    back = fitted_to(log, "linear", direction="command")
    assert (rmse(back) < 0.7 * rmse(back, "raw")).all()
    with pytest.raises(DataError, match="effort"):
        fitted_to(LOG, "linear", direction="command", features=("position", "effort"))


def test_intervals_cover_held_out_motion() -> None:
    """95 % intervals of each joint hold at least 85 % of the errors on trajectories never seen."""
    gp = fitted("gp")
    assert (gp.evaluation.dirty.coverage95 > 0.85).all()


def test_a_short_run_sets_a_new_zero() -> None:
    """After a homing that moved joint 2, one minute brings the errors back, and says which joint moved."""
    corrector: JointCorrector = fitted("gp").corrector
    after = joint_log(2, trajectories=2, shift=0.02)
    everything = np.ones(len(after), dtype=bool)
    rows = corrector.zeros(after, corrector.measure(after, everything))
    assert [row["moved"] for row in rows] == [False, True, False]
    assert rows[1]["shift"] == pytest.approx(np.rad2deg(0.02), abs=0.2)
    fresh = corrector.rezeroed(after)
    other = joint_log(3, trajectories=2, shift=0.02)
    left = [np.abs(c.measure(other, np.ones(len(other), bool)).corrected)[:, 1].mean() for c in (corrector, fresh)]
    assert left[1] < 0.3 * left[0]


def test_joints_that_never_move_are_left_as_they_are() -> None:
    """The others are fitted; the still one is said to be, keeps its value, and away from its place nothing is known."""
    q = np.array(LOG.measured_jp)
    q[:, 1] = 1.0
    experiment = fitted_to(replace(LOG, measured_jp=q), "linear")
    corrector: JointCorrector = experiment.corrector
    assert any("joint 2 never moves" in remark for remark in experiment.fit.remarks)
    answer = corrector.correct_path(q[:50], LOG.time[:50], LOG.measured_jf[:50])
    np.testing.assert_array_equal(answer.joints[:, 1], 1.0)
    assert np.isnan(answer.std[:, 1]).all()
    assert np.isfinite(answer.std[:, [0, 2]]).all()
    missed = np.abs(LOG.external_jp[:, 1] - 1.0)[: len(LOG) * 4 // 5]
    np.testing.assert_allclose(answer.interval95[:, 1], np.percentile(missed, 99.5), rtol=0.05)
    assert corrector.correct_path(
        q[:50] + np.array([0.0, 1e-3, 0.0]), LOG.time[:50], LOG.measured_jf[:50]
    ).in_domain.all()
    for away in (0.3, 0.02):  # an insertion that is taken to turn moves by 0.02 at once
        strayed = corrector.correct_path(q[:50] + np.array([0.0, away, 0.0]), LOG.time[:50], LOG.measured_jf[:50])
        assert not strayed.in_domain.any()


def test_planted_outliers_are_dropped() -> None:
    """Faults of the outside encoder are rejected before the fit, and the errors stay what they are without them."""
    rng = np.random.default_rng(4)
    truth = np.array(LOG.external_jp)
    bad = rng.choice(len(truth) * 4 // 5, 20, replace=False)
    truth[bad] += rng.choice([-1, 1], (20, 1)) * np.array([0.3, 0.3, 0.03])
    faulty, plain = fitted_to(replace(LOG, external_jp=truth), "linear"), fitted("linear")
    assert not faulty.fit.cleaning.keep[bad].any()
    assert (~faulty.fit.cleaning.keep).sum() < 40
    assert (rmse(faulty) < 1.1 * rmse(plain)).all()


def test_a_single_motion_is_held_out_in_blocks() -> None:
    """A log of one trajectory is measured on its last fifth; by session it is measured on whole sessions."""
    single = replace(LOG, trajectory=np.zeros(len(LOG), dtype=np.int64))
    experiment = fitted_to(single, "linear")
    assert len(experiment.test) == pytest.approx(len(LOG) / 5, rel=0.05)
    sessions = replace(LOG, session=(LOG.trajectory >= 3).astype(np.int64))
    by_session = run_experiment(sessions, FitSettings(method="linear"), task=JointCorrector, by=HoldOut.SESSION)
    assert np.unique(by_session.test.session).tolist() == [1]


def test_what_is_held_out_is_measured_with_the_motion_before_it() -> None:
    """As a stream answers, which saw it: alone the held-out part would begin with its slack unknown."""
    experiment = fitted("gp")
    held = np.isin(LOG.trajectory, experiment.test.trajectory_ids)
    everything = np.ones(len(LOG), dtype=bool)
    whole, part = experiment.corrector.measure(LOG, everything), experiment.evaluation.dirty
    place = np.searchsorted(whole.rows, np.flatnonzero(held)[part.rows])
    np.testing.assert_allclose(part.corrected, whole.corrected[place], atol=1e-12)
    np.testing.assert_array_equal(part.time, experiment.test.time[part.rows])


def test_bad_logs_are_named() -> None:
    """No motion at all, millimetres, a missing signal, no efforts: each is refused with its reason."""
    q, truth = np.array(LOG.measured_jp), np.array(LOG.external_jp)
    cases: list[tuple[type[Exception], str, CalibrationLog, dict[str, object]]] = [
        (DegenerateError, "no joint ever moves", replace(LOG, measured_jp=np.ones(q.shape)), {}),
        (LogError, "mm", replace(LOG, measured_jp=q * np.array([1, 1, 1e3])), {}),
        (LogError, "external_jp", replace(LOG, external_jp=None), {}),
        (LogError, "joints", replace(LOG, external_jp=truth[:, :2]), {}),
        (DataError, "measured_jf", replace(LOG, measured_jf=None), {"features": ("position", "effort")}),
    ]
    for error, words, log, changes in cases:
        with pytest.raises(error, match=words):
            fitted_to(log, "linear", **changes)
    with pytest.raises(DataError, match="one of"):
        fitted("forest")


def test_missing_numbers_are_passed_over() -> None:
    """Samples without input or effort leave their answer empty or predicted, never the whole path."""
    few = joint_log(1, trajectories=3)
    effort = np.array(few.measured_jf)
    effort[::7] = np.nan
    q = np.array(few.measured_jp)
    q[100:110] = np.nan
    log = replace(few, measured_jf=effort, measured_jp=q)
    for method in ("ukf", "gp"):
        experiment = fitted_to(log, method)
        answer = experiment.corrector.correct_log(log)
        assert np.isfinite(answer.joints[120:140]).any()
        assert (np.array(answer.status)[100:110] == "MISSING").all()
        assert np.isfinite(rmse(experiment)).all()


def test_real_wrist_is_better_than_every_reference() -> None:
    """On a real arm, last fifth held out, every joint beats linear models with history and a plain regression."""
    log = read_log(real_data("dvrk_random.csv"))
    found = rmse(run_experiment(log, FitSettings(), task=JointCorrector))
    assert (found < np.array([0.042, 0.035, 0.110, 1.36, 3.5, 2.5])).all()


def test_a_state_of_other_columns_is_refused(tmp_path: Path) -> None:
    """As many columns of other names were taken for those of the training, and the answers were degrees off."""
    beside = np.random.default_rng(0).normal(size=len(LOG))
    model = fitted_to(replace(LOG, extra={"current": beside}), "linear", features=("position", "state")).corrector
    save(model, tmp_path / "m.gpc")
    for corrector in (model, load(tmp_path / "m.gpc", JointCorrector)):
        corrector.correct_log(replace(LOG, extra={"current": beside}))
        with pytest.raises(DataError, match="missing: current_1; new: pressure_1"):
            corrector.correct_log(replace(LOG, extra={"pressure": beside}))
