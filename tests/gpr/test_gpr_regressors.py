"""Laws that both regressors keep."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gpr_fields import correlated_noise, planted, stretches
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.utils.estimator_checks import parametrize_with_checks

from gpcorrect.errors import DataError
from gpcorrect.gpr import ExactGPR, SparseGPR
from gpcorrect.gpr.statistics import Points
from gpcorrect.types import Progress

BOTH = pytest.mark.parametrize("make", [ExactGPR, SparseGPR])


@parametrize_with_checks([ExactGPR(), SparseGPR()])
def test_scikit_learn_contract(estimator: Any, check: Any) -> None:
    """Every check of scikit-learn's estimator contract passes."""
    check(estimator)


@BOTH
def test_held_out_error_is_near_the_noise_floor_and_intervals_cover(make: Any) -> None:
    """On a planted field the mean is better than the noise and 95 % intervals cover 92-98 %."""
    X, Y, field = planted(800, seed=0, noise=0.2)
    model = make().fit(X[:600], Y[:600])
    mean, std = model.predict(X[600:], return_std=True)
    assert np.sqrt(((mean - field[600:]) ** 2).mean()) < 0.15
    assert 0.92 < (np.abs(mean - Y[600:]) < 1.96 * std).mean() < 0.98


def test_exact_agrees_with_scikit_learn_under_the_same_hyperparameters() -> None:
    """Mean and standard deviation of an independent implementation, output by output."""
    X, Y, _ = planted(80, seed=1)
    model = ExactGPR().fit(X, Y)
    mean, std = model.predict(X[:20] + 0.3, return_std=True)
    scales = model.learned_[0].kernel.length_scales[0]
    signal, noise = model.predictor_.parts[0].signal, model.predictor_.parts[0].noise
    for o in range(2):
        kernel = ConstantKernel(signal[o]) * RBF(scales) + WhiteKernel(noise[o])
        peer = GaussianProcessRegressor(kernel, optimizer=None).fit(X, Y[:, o] - Y[:, o].mean())
        peer_mean, peer_std = peer.predict(X[:20] + 0.3, return_std=True)
        np.testing.assert_allclose(mean[:, o], peer_mean + Y[:, o].mean(), atol=1e-8)
        np.testing.assert_allclose(std[:, o], peer_std, rtol=1e-6)


def test_sparse_with_every_sample_inducing_is_exact() -> None:
    """Titsias' posterior is the exact one when nothing is left out."""
    X, Y, _ = planted(120, seed=2)
    exact = ExactGPR(n_learn=120).fit(X, Y).predict(X + 0.1, return_std=True)
    sparse = SparseGPR(n_inducing=120, n_variance=120, n_learn=120).fit(X, Y).predict(X + 0.1, return_std=True)
    np.testing.assert_allclose(sparse[0], exact[0], atol=2e-4)
    np.testing.assert_allclose(sparse[1], exact[1], rtol=1e-3)


def test_sparse_with_few_points_is_near_the_exact_model_on_all_data() -> None:
    """A fifth of the samples as inducing points costs less than 5 % of the error to the truth."""
    X, Y, field = planted(1500, seed=3, noise=0.2)
    errors = [
        np.sqrt(((model.fit(X[:1000], Y[:1000]).predict(X[1000:]) - field[1000:]) ** 2).mean())
        for model in (ExactGPR(n_learn=300), SparseGPR(n_inducing=200, n_variance=200, n_learn=300))
    ]
    assert errors[1] < 1.05 * errors[0]


def test_a_variance_on_fewer_points_is_more_careful() -> None:
    """Leaving out points of the variance widens it (nowhere lessens it by more than 5 %), and leaves the mean alone."""
    X, Y, _ = planted(400, seed=4)
    full, part = (SparseGPR(n_inducing=150, n_variance=q).fit(X, Y) for q in (150, 60))
    wide, narrow = part.predict(X, return_std=True), full.predict(X, return_std=True)
    np.testing.assert_allclose(wide[0], narrow[0], rtol=1e-9)
    assert (wide[1] > 0.95 * narrow[1]).all()
    assert wide[1].mean() > narrow[1].mean()


def test_the_posterior_does_not_depend_on_the_order_or_blocks_of_the_samples() -> None:
    """More rows than a block, shuffled: the same sums."""
    X, Y, _ = planted(5000, seed=5)
    model = SparseGPR(n_inducing=50, n_learn=100).fit(X, Y)
    order = np.random.default_rng(0).permutation(5000)
    points = Points.of(model.predictor_.parts[0])
    seen = [points.collect(a, b, Progress()) for a, b in ((X, Y), (X[order], Y[order]))]
    np.testing.assert_allclose(seen[0].G, seen[1].G, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(seen[0].Vy, seen[1].Vy, rtol=1e-9, atol=1e-9)


@BOTH
def test_units_of_inputs_and_outputs_do_not_matter(make: Any) -> None:
    """Millimetres for metres, and a shift: predictions follow."""
    X, Y, _ = planted(150, seed=6)
    mean, std = make().fit(X, Y).predict(X[:30], return_std=True)
    scale, shift = np.array([1e3, 1.0, 1e-3]), np.array([5.0, -2.0])
    other, other_std = make().fit(X * scale + 7.0, 1e3 * Y + shift).predict(X[:30] * scale + 7.0, return_std=True)
    np.testing.assert_allclose(other, 1e3 * mean + shift, rtol=1e-3, atol=1e-1)
    np.testing.assert_allclose(other_std, 1e3 * std, rtol=1e-3)


@BOTH
def test_one_output_may_be_a_vector(make: Any) -> None:
    """A 1-D y gives 1-D predictions, equal to those of a single column."""
    X, Y, _ = planted(60, seed=7)
    flat, flat_std = make().fit(X, Y[:, 0]).predict(X, return_std=True)
    column, column_std = make().fit(X, Y[:, :1]).predict(X, return_std=True)
    assert flat.shape == flat_std.shape == (60,)
    np.testing.assert_allclose(flat, column[:, 0])
    np.testing.assert_allclose(flat_std, column_std[:, 0])


@BOTH
def test_ten_rows_are_enough_and_duplicates_and_constant_columns_harmless(make: Any) -> None:
    """Stop-and-measure repeats rows, and a motion may hold a feature still: predictions stay finite, std positive."""
    X, Y, _ = planted(10, seed=8)
    X[:, 2] = 0.123456
    X, Y = np.tile(X, (3, 1)), np.tile(Y, (3, 1))
    Y[:, 1] = 4.0
    for rows in (slice(0, 10), slice(None)):
        mean, std = make().fit(X[rows], Y[rows]).predict(X, return_std=True)
        assert np.isfinite(mean).all()
        assert (std > 0).all()
    np.testing.assert_allclose(mean[:, 1], 4.0, atol=1e-6)


@BOTH
def test_one_row_is_refused_with_the_reason(make: Any) -> None:
    """One sample does not make a regression."""
    with pytest.raises(ValueError, match="1 sample"):
        make().fit(np.zeros((1, 3)), np.zeros(1))


def test_exact_refuses_more_than_it_can_bear() -> None:
    """The error names the alternative."""
    with pytest.raises(DataError, match="SparseGPR"):
        ExactGPR().fit(np.zeros((6001, 1)), np.zeros(6001))


@BOTH
def test_the_same_seed_gives_the_same_model(make: Any) -> None:
    """Nothing random is left outside the seed."""
    X, Y, _ = planted(120, seed=9)
    first, second = (make(n_learn=60, random_state=3).fit(X, Y).predict(X) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@BOTH
def test_refit_keeps_hyperparameters_and_leaves_the_first_model_alone(make: Any) -> None:
    """A refit on the same data is the same model; on other data only the posterior differs."""
    X, Y, _ = planted(200, seed=10)
    model = make().fit(X, Y)
    before = model.predict(X)
    other = model.refit(X[:100], Y[:100])
    np.testing.assert_array_equal(model.predict(X), before)
    assert other.learned_ is model.learned_
    np.testing.assert_allclose(model.refit(X, Y).predict(X), before, atol=1e-8)
    assert np.abs(other.predict(X) - before).max() > 1e-3


def test_an_additive_field_is_learned_better_by_components() -> None:
    """Where half the field is of one feature alone, the kernel with groups predicts better than the plain one."""
    rng = np.random.default_rng(11)
    X = rng.standard_normal((700, 6))
    field = np.sin(2.5 * X[:, :1]) * np.cos(1.5 * X[:, 1:2]) + np.tanh(3 * X[:, 3:4]) * X[:, 4:5]
    Y = field + 0.1 * rng.standard_normal(field.shape)
    plain, grouped = (
        SparseGPR(feature_groups=g, n_learn=300).fit(X[:300], Y[:300]) for g in (None, [(0, 1, 2), (3, 4, 5)])
    )
    errors = [np.sqrt(((model.predict(X[300:]) - field[300:]) ** 2).mean()) for model in (plain, grouped)]
    assert errors[1] < 0.8 * errors[0]


def test_groups_and_times_give_honest_deviations_under_correlated_noise() -> None:
    """Slow noise on slow inputs: with groups intervals cover new trajectories and the error falls."""
    rng = np.random.default_rng(12)
    groups, times = stretches(40, 40, 0.1)
    X = np.column_stack([correlated_noise(40, 40, 0.1, 10.0, rng) for _ in range(3)])
    field = np.tanh(X[:, :1])
    Y = field + 0.5 * correlated_noise(40, 40, 0.1, 2.0, rng)[:, None]
    train = groups < 30
    cover, errors = [], []
    for known in ({}, {"groups": groups[train], "times": times[train]}):
        mean, std = SparseGPR().fit(X[train], Y[train], **known).predict(X[~train], return_std=True)
        cover.append((np.abs(mean - Y[~train]) < 1.96 * std).mean())
        errors.append(np.sqrt(((mean - field[~train]) ** 2).mean()))
    assert cover[0] < 0.85
    assert 0.92 < cover[1] < 0.98
    assert errors[1] < 0.8 * errors[0]


def test_times_without_groups_and_groups_of_another_length_are_refused() -> None:
    """What cannot be understood is not guessed."""
    X, Y, _ = planted(20, seed=13)
    with pytest.raises(DataError, match="groups"):
        SparseGPR().fit(X, Y, times=np.arange(20.0))
    with pytest.raises(ValueError, match="inconsistent"):
        SparseGPR().fit(X, Y, groups=np.zeros(19))


def test_progress_runs_from_hyperparameters_to_a_finished_posterior() -> None:
    """Every stage ends at one."""

    class Log(Progress):
        def __init__(self) -> None:
            self.steps: dict[str, list[float]] = {}

        def step(self, stage: str, done: float) -> None:
            self.steps.setdefault(stage, []).append(done)

    X, Y, _ = planted(3000, seed=14)
    log = Log()
    SparseGPR(n_inducing=20, n_learn=50).fit(X, Y, progress=log)
    assert list(log.steps) == ["hyperparameters", "posterior"]
    assert all(steps[-1] == 1.0 and steps == sorted(steps) for steps in log.steps.values())


def test_the_callers_arrays_stay_as_they_were() -> None:
    """Fitting and predicting change neither X nor y."""
    X, Y, _ = planted(50, seed=15)
    kept = X.copy(), Y.copy()
    SparseGPR().fit(X, Y).predict(X, return_std=True)
    np.testing.assert_array_equal(X, kept[0])
    np.testing.assert_array_equal(Y, kept[1])


@BOTH
def test_groups_of_outputs_are_models_of_their_own(make: Any) -> None:
    """With output groups of one, every output is predicted as if it were alone."""
    X, Y, _ = planted(120, seed=16)
    together = make(output_groups=(1, 1)).fit(X, Y)
    mean, std = together.predict(X, return_std=True)
    first, first_std = make().fit(X, Y[:, 0]).predict(X, return_std=True)
    np.testing.assert_allclose(mean[:, 0], first)
    np.testing.assert_allclose(std[:, 0], first_std)
    scales = [learned.kernel.length_scales for learned in together.learned_]
    assert not np.allclose(*scales)


def test_output_groups_that_do_not_add_up_are_refused() -> None:
    """Two and two outputs are not three."""
    X, Y, _ = planted(20, seed=17)
    with pytest.raises(DataError, match="do not make 2"):
        SparseGPR(output_groups=(2, 2)).fit(X, Y)


@pytest.mark.parametrize("first", ["nothing", "groups", "groups and times"])
@pytest.mark.parametrize("then", ["nothing", "groups", "groups and times"])
def test_data_of_another_kind_are_not_relearned(first: str, then: str) -> None:
    """Groups and times are given where the first fit had them, and only there; else the error says so."""
    X, Y, _ = planted(80, seed=4)
    groups = np.repeat(np.arange(8), 10)
    known = {
        "nothing": {},
        "groups": {"groups": groups},
        "groups and times": {"groups": groups, "times": np.arange(80.0)},
    }
    model = SparseGPR(n_inducing=20, n_learn=40).fit(X, Y, **known[first])
    if first == then:
        assert model.relearn(X, Y, **known[then]).predict(X).shape == Y.shape
        return
    with pytest.raises(DataError, match="cannot go on with") as refused:
        model.relearn(X, Y, **known[then])
    assert "Give groups and times where the first fit had them" in str(refused.value)


def test_samples_between_those_that_stand_for_them_can_be_taken_in_later() -> None:
    """Fitted to every third sample and then with all, a model is the one fitted to all; before, it counts as many."""
    X, Y, _ = planted(300, seed=5)
    parts = np.arange(300) // 100
    make = SparseGPR(n_inducing=40, n_learn=100)
    whole, third = (clone(make).fit_by_parts(X, Y, parts, stride=stride) for stride in (1, 3))
    assert third.statistics_[0].n == pytest.approx(300, abs=6)
    np.testing.assert_allclose(third.with_all(X, Y, parts).predict(X), whole.predict(X), atol=1e-9)
