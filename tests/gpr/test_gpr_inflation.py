"""Laws of counting neighbouring samples that err together as fewer than they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gpr_fields import correlated_noise, smooth_field, stretches

from gpcorrect.codec import pack, unpack
from gpcorrect.errors import DataError
from gpcorrect.gpr import SparseGPR, Statistics, learn_inflation
from gpcorrect.gpr.statistics import collected
from gpcorrect.types import FloatArray, IntArray

GROUPS, STEPS, STEP = 20, 60, 0.01


def tracked(seed: int, *, shared: bool) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return slow trajectories through a planted field: inputs, outputs, the field, trajectory of each sample.

    Their noise is the same over seconds when `shared`, else each sample's own.
    """
    rng = np.random.default_rng(seed)
    trajectory, _ = stretches(GROUPS, STEPS, STEP)
    X = np.column_stack([correlated_noise(GROUPS, STEPS, STEP, 3.0, rng) for _ in range(3)])
    field = smooth_field(X, rng)
    white = rng.standard_normal(field.shape)
    common = np.column_stack([correlated_noise(GROUPS, STEPS, STEP, 1.0, rng) for _ in range(2)])
    return X, field + (common if shared else white), field, trajectory


def fitted(X: FloatArray, Y: FloatArray, trajectory: IntArray) -> SparseGPR:
    times = stretches(GROUPS, STEPS, STEP)[1]
    return SparseGPR(n_inducing=150, n_learn=300).fit(X, Y, groups=trajectory, times=times)


def test_noise_that_neighbours_share_makes_many_samples_count_as_one() -> None:
    """On trajectories that err as a whole the inflation is above one, and the field is found better with it."""
    X, Y, field, trajectory = tracked(0, shared=True)
    model = fitted(X, Y, trajectory)
    inflated, _ = learn_inflation(model, X, Y, trajectory % 4)
    assert inflated.inflation is not None
    assert inflated.inflation[0] > 1.0
    before, after = (np.square(m.predict(X) - field).mean() for m in (model, inflated))
    assert after < 0.8 * before


def test_white_noise_is_left_as_it_is() -> None:
    """Where every sample errs by itself every sample counts."""
    X, Y, _, trajectory = tracked(1, shared=False)
    inflated, _ = learn_inflation(fitted(X, Y, trajectory), X, Y, trajectory % 4)
    assert inflated.inflation == (1.0,)


def test_the_left_out_are_those_of_the_other_folds() -> None:
    """Errors and deviations of a fold are what the other folds alone, under the same points, give for it."""
    X, Y, _, trajectory = tracked(2, shared=True)
    folds = trajectory % 3
    inflated, left_out = learn_inflation(fitted(X, Y, trajectory), X, Y, folds)
    assert inflated.inflation is not None
    others = inflated.resting_on(collected(inflated.points_, X[folds != 1], Y[folds != 1])).inflated(inflated.inflation)
    mean, std, novelty = others.predictor_.mean_std_batch(X[folds == 1])
    np.testing.assert_allclose(left_out.errors[folds == 1], Y[folds == 1] - mean, atol=1e-8)
    np.testing.assert_allclose(left_out.std[folds == 1], std, rtol=1e-8)
    np.testing.assert_allclose(left_out.novelty[folds == 1], novelty, atol=1e-8)


def test_of_few_trajectories_nothing_is_learned_from_the_left_out() -> None:
    """What is said of a fold is, to a tenth of the noise, what a model fitted to two thirds from scratch says."""
    X, Y, _, trajectory = tracked(2, shared=True)
    rest, times = trajectory % 3 != 1, stretches(GROUPS, STEPS, STEP)[1]
    inflated, left_out = learn_inflation(fitted(X, Y, trajectory), X, Y, trajectory % 3, trajectory, times)
    assert inflated.inflation is not None
    alone = SparseGPR(n_inducing=150, n_learn=200).fit(X[rest], Y[rest], groups=trajectory[rest], times=times[rest])
    expected = alone.inflated(inflated.inflation).predict(X[~rest])
    assert np.sqrt(np.mean(((Y - left_out.errors)[~rest] - expected) ** 2)) < 0.1


def test_a_single_fold_is_refused() -> None:
    """There must be something left to learn from."""
    X, Y, _, trajectory = tracked(2, shared=True)
    with pytest.raises(DataError, match="two folds"):
        learn_inflation(fitted(X, Y, trajectory), X, Y, np.zeros(len(X), dtype=int))


def test_inflation_is_that_of_every_sample_weighing_less() -> None:
    """With points enough to see the field, samples inflated by three answer as samples that weigh a third."""
    X, Y, _, trajectory = tracked(3, shared=True)
    model = fitted(X, Y, trajectory)
    [part], [sums] = model.predictor_.parts, model.statistics_
    L, ratio = np.eye(len(part.basis)), part.noise / part.signal
    seen = Statistics(sums.G * len(X) / np.trace(sums.G), sums.Vy, sums.n)  # nothing unseen
    third = Statistics(seen.G / 3, seen.Vy / 3, seen.n / 3)
    np.testing.assert_allclose(
        replace(seen, inflation=3.0).mean_weights(L, ratio), third.mean_weights(L, ratio), rtol=1e-6, atol=1e-9
    )


def test_inflation_stays_when_data_come_and_go_and_with_the_file() -> None:
    """Added, taken away and stored statistics keep the inflation of those they belong to."""
    sums = Statistics(np.eye(3), np.ones((3, 2)), 3.0, inflation=10.0)
    other = Statistics(np.eye(3), np.ones((3, 2)), 3.0)
    for kept in (sums.plus(other), sums.minus(other), unpack(Statistics, *pack(sums, "sums"))):
        assert kept.inflation == 10.0


def test_as_many_left_out_are_predicted_as_are_asked_for() -> None:
    """Those that choose the inflation may be fewer, but the intervals rest on every sample, or on every third."""
    rng = np.random.default_rng(5)
    X, trajectory = rng.uniform(-1.0, 1.0, (4500, 2)), np.arange(4500) // 450
    Y = X[:, :1] + 0.1 * rng.standard_normal((4500, 1))
    model = SparseGPR(n_inducing=20, n_learn=100).fit(X, Y, groups=trajectory)
    for stride in (1, 3):
        left_out = learn_inflation(model, X, Y, trajectory % 2, stride=stride)[1]
        assert np.isfinite(left_out.errors).mean() == pytest.approx(1.0 / stride)
