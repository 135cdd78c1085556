"""Boosted trees, the mixture of learners, and lags that a recording has to earn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log
from sklearn.ensemble import HistGradientBoostingRegressor

from gpcorrect.calibration import FitSettings, JointCorrector, JointStream, fit_model
from gpcorrect.calibration.learners import trees
from gpcorrect.calibration.learners.auto import _stacking_weights
from gpcorrect.calibration.learners.trees import TreesMap
from gpcorrect.calibration.memory import lagged
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray


def creeping(log: CalibrationLog, constant: float, share: float) -> CalibrationLog:
    """Return a log whose joints also creep: a share of every motion arrives by a first-order lag."""
    assert log.measured_jp is not None
    q, time = log.measured_jp, log.time
    behind = lagged(q, time, np.arange(len(q)) == 0, np.array([constant]))[:, 0]
    return replace(log, measured_jf=None, external_jp=log.external_jp - share * behind)


@pytest.mark.parametrize("seed", range(3))
def test_the_table_of_trees_answers_as_scikit_learn(seed: int) -> None:
    """On inputs seen, unseen and at the edges of floating point."""
    rng = np.random.default_rng(seed)
    X, Y = rng.standard_normal((400, 3)), rng.standard_normal((400, 2))
    table = TreesMap.fit(X, Y, seed)
    asked = np.vstack([X, 3.0 * rng.standard_normal((200, 3)), np.full((1, 3), 1e300), np.full((1, 3), -1e300)])
    options = {"max_iter": trees.ROUNDS, "learning_rate": trees.RATE, "max_bins": trees.BINS}
    for k, y in enumerate(Y.T):
        peer = HistGradientBoostingRegressor(
            early_stopping=False, random_state=seed, min_samples_leaf=trees.LEAST_IN_LEAF, **options
        ).fit(X, y)
        np.testing.assert_allclose(table.mean(asked)[:, k], peer.predict(asked), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("part", "at", "to"), [("left", 0, 0), ("right", 0, 10**6), ("roots", 1, -1), ("target", 3, 7), ("roots", 0, 10**6)]
)
def test_trees_that_lead_nowhere_are_refused(part: str, at: int, to: int) -> None:
    """A damaged file makes no endless walk, and reads no memory that is not the trees'."""
    rng = np.random.default_rng(0)
    table = TreesMap.fit(rng.standard_normal((200, 2)), rng.standard_normal((200, 1)), 0)
    damaged = getattr(table, part).copy()
    damaged[at] = to
    with pytest.raises(DataError, match="damaged"):
        replace(table, **{part: damaged})
    with pytest.raises(DataError, match="2 inputs"):
        table.mean(np.zeros((1, 1)))


@pytest.mark.parametrize("seed", range(5))
def test_a_mixture_is_never_worse_than_its_best_member(seed: int) -> None:
    """Weights are shares, an exact member takes all, and no member alone has smaller errors."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal((300, 2))
    errors = [s * common + rng.standard_normal((300, 2)) for s in (0.5, 1.0, 2.0)]
    weights = _stacking_weights(errors)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    mixed = np.einsum("km,knm->nm", weights, np.stack(errors))
    assert ((mixed**2).sum(axis=0) <= (1 + 1e-6) * np.min([(e**2).sum(axis=0) for e in errors], axis=0)).all()
    np.testing.assert_allclose(_stacking_weights([errors[0], 0.0 * common, errors[2]])[1], 1.0, atol=1e-6)


def test_lags_do_not_depend_on_how_often_a_motion_is_sampled() -> None:
    """Samples between two others, on the line through them, change nothing; unknown ones are taken to have stood."""
    rng = np.random.default_rng(0)
    coarse = np.cumsum(rng.uniform(0.05, 0.5, 40))
    signal, constants = rng.standard_normal((40, 2)), np.array([0.1, 3.0])
    fine = np.unique(np.concatenate([coarse, rng.uniform(coarse[0], coarse[-1], 500)]))
    between = np.column_stack([np.interp(fine, coarse, column) for column in signal.T])
    one = lagged(signal, coarse, np.arange(40) == 0, constants)
    other = lagged(between, fine, np.arange(len(fine)) == 0, constants)
    np.testing.assert_allclose(other[np.searchsorted(fine, coarse)], one, atol=1e-12)
    signal[20:25, 1] = np.nan
    held = np.where(np.isfinite(signal), signal, signal[19])
    np.testing.assert_array_equal(
        lagged(signal, coarse, np.arange(40) == 0, constants), lagged(held, coarse, np.arange(40) == 0, constants)
    )


def held_out_rmse(log: CalibrationLog, **changes: object) -> tuple[FloatArray, JointCorrector]:
    """Return errors on the last trajectories of a model of the others, and the model."""
    last = log.trajectory >= log.trajectory.max() - 1
    settings = FitSettings(inducing=100, **changes)  # type: ignore[arg-type]
    model: JointCorrector = fit_model(log.select(~last), settings, task=JointCorrector).corrector
    measured = model.measure(log.select(last), np.ones(int(last.sum()), dtype=bool))
    return np.sqrt((measured.corrected**2).mean(axis=0)), model


def test_lags_are_learned_where_joints_creep_and_nowhere_else() -> None:
    """With creep of 2 s the lags make errors smaller; without, none is used. A stream follows them as the path does."""
    log = creeping(joint_log(3, trajectories=8), constant=2.0, share=0.1)
    without, _ = held_out_rmse(log, features=("position", "velocity", "memory"))
    with_lags, model = held_out_rmse(log, features=("position", "velocity", "memory", "lags"))
    assert (with_lags < 0.95 * without).all()
    assert "lags" in model.view.features.origins[0]
    path, stream = model.correct_log(log).joints, JointStream(model)
    assert path is not None
    live = [stream.correct(float(t), q).joints for t, q in zip(log.time[:200], log.measured_jp, strict=False)]
    np.testing.assert_allclose(live, path[:200], atol=1e-9)
    _, plain = held_out_rmse(replace(joint_log(3, trajectories=8), measured_jf=None))
    assert "lags" not in plain.view.features.origins[0]


def test_accelerations_are_learned_where_joints_spring_and_nowhere_else() -> None:
    """Links that give way under their inertia need them, stiff ones have none. A stream follows as the path does."""
    log, rng, kinds = joint_log(3, trajectories=8), np.random.default_rng(0), ("position", "velocity", "acceleration")
    stiff = replace(log, measured_jf=None, external_jp=log.measured_jp + 1e-4 * rng.standard_normal((len(log), 3)))
    pull = np.gradient(np.gradient(log.measured_jp, log.time, axis=0), log.time, axis=0)
    springing = replace(stiff, external_jp=stiff.external_jp - 0.02 * pull)
    without, _ = held_out_rmse(springing, method="linear", features=kinds[:2])
    knowing, model = held_out_rmse(springing, method="linear", features=kinds)
    assert (knowing[:2] < 0.7 * without[:2]).all()
    assert "acceleration" in model.view.features.origins[0]
    path, stream = model.correct_log(springing).joints, JointStream(model)
    assert path is not None
    live = [stream.correct(float(t), q).joints for t, q in zip(log.time[:200], log.measured_jp, strict=False)]
    np.testing.assert_allclose(live, path[:200], atol=1e-9)
    _, plain = held_out_rmse(stiff, method="linear", features=kinds)
    assert "acceleration" not in plain.view.features.origins[0]


def test_an_error_that_goes_by_the_pose_alone_is_learned_without_the_past() -> None:
    """In few motions everything of the past is new in each: what sees positions alone errs half as much there."""
    log, rng = joint_log(3, trajectories=8), np.random.default_rng(0)
    q = log.measured_jp / np.ptp(log.measured_jp, axis=0)
    error = 0.01 * np.sin(q @ rng.uniform(1.0, 4.0, (3, 3)) + rng.uniform(0.0, 6.0, 3))
    noisy = log.measured_jp + error + 1e-4 * rng.standard_normal(error.shape)
    by_pose = replace(log, measured_jf=None, external_jp=noisy)
    with_past, _ = held_out_rmse(by_pose)
    mixed, _ = held_out_rmse(by_pose, method="auto")
    assert (mixed < 0.5 * with_past).all()
