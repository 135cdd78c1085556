from __future__ import annotations

import numpy as np
import pytest
from gpr_fields import correlated_noise, planted, stretches
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from gpcorrect.gpr.kernels import component_masks
from gpcorrect.gpr.learning import learn
from gpcorrect.gpr.likelihood import Layout, LearningData, negative_log_posterior, profiled_signal, sample_lags
from gpcorrect.types import Progress


def case(kind: str) -> tuple[LearningData, Layout]:
    X, Y, _ = planted(40, seed=3)
    groups, times = stretches(4, 10, 0.1)
    masks = component_masks(3, [(0, 1), (2,)])
    if kind == "white":
        return LearningData(X, Y, sample_lags(None, None)), Layout(masks, 2)
    if kind == "groups":
        return LearningData(X, Y, sample_lags(groups, None)), Layout(masks, 2, correlated=True)
    return LearningData(X, Y, sample_lags(groups, times)), Layout(masks, 2, correlated=True, time_range=(0.01, 10.0))


@pytest.mark.parametrize("kind", ["white", "groups", "times"])
@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_is_that_of_finite_differences(kind: str, seed: int) -> None:
    """Every analytic derivative agrees with a central difference to 1e-5 of the largest."""
    data, layout = case(kind)
    theta = layout.start + 0.4 * np.random.default_rng(seed).standard_normal(len(layout.start))
    _, gradient = negative_log_posterior(theta, data, layout)
    step = 1e-6
    numeric = [
        negative_log_posterior(theta + e, data, layout)[0] - negative_log_posterior(theta - e, data, layout)[0]
        for e in step * np.eye(len(theta))
    ]
    np.testing.assert_allclose(gradient, np.array(numeric) / (2 * step), atol=1e-5 * np.abs(gradient).max())


def test_the_value_is_that_of_scikit_learn_at_the_best_signal_variance() -> None:
    """With white noise, one component and the profiled signal variance, the likelihood is the textbook one."""
    X, Y, _ = planted(30, seed=4)
    layout = Layout(component_masks(3, None), 2)
    theta = layout.start + 0.2
    data = LearningData(X, Y, sample_lags(None, None))
    kernel, noise, signal = layout.kernel(theta), layout.noise(theta), profiled_signal(theta, data, layout)
    expected = 0.0
    for o in range(2):
        covariance = ConstantKernel(signal[o]) * RBF(kernel.length_scales[0]) + WhiteKernel(signal[o] * noise.ratio[o])
        peer = GaussianProcessRegressor(covariance, optimizer=None).fit(X, Y[:, o])
        expected -= peer.log_marginal_likelihood_value_
    constant = Y.size * (np.log(2 * np.pi) + 1) / 2
    value, _ = negative_log_posterior(theta, data, layout)
    assert value - layout.penalty(theta)[0] + constant == pytest.approx(expected, rel=1e-8)


def learned(X, Y, groups=None, times=None):  # type: ignore[no-untyped-def]
    return learn(X, Y, component_masks(X.shape[1], None), groups, times, progress=Progress())


def test_planted_length_scales_and_noise_are_recovered() -> None:
    """Length scales come out within 20 % and the noise within 20 %."""
    X, Y, _ = planted(400, seed=5, noise=0.2)
    found = learned(X, Y)
    np.testing.assert_allclose(found.kernel.length_scales[0, :2], [0.8, 1.6], rtol=0.2)
    np.testing.assert_allclose(np.sqrt(found.noise), 0.2, rtol=0.2)


def test_a_feature_that_does_not_matter_gets_a_long_length_scale() -> None:
    """Automatic relevance determination: noise in a feature is not taken for signal."""
    X, Y, _ = planted(200, seed=6)
    found = learned(np.column_stack([X, np.random.default_rng(0).standard_normal(200)]), Y)
    assert found.kernel.length_scales[0, 3] > 5


def test_noise_that_neighbours_share_is_recognised_and_its_time_recovered() -> None:
    """Planted: half the field's size of noise, all of it correlated over 0.5 s."""
    rng = np.random.default_rng(7)
    X, _, field = planted(400, seed=8)
    groups, times = stretches(20, 20, 0.1)
    noise = np.column_stack([correlated_noise(20, 20, 0.1, 0.5, rng) for _ in range(2)])
    found = learned(X, field + 0.5 * noise, groups, times)
    assert found.correlated_share.min() > 0.8
    assert 0.25 < found.correlation_time < 1.0
    np.testing.assert_allclose(np.sqrt(found.noise), 0.5, rtol=0.25)


def test_white_noise_is_not_taken_for_correlated_noise() -> None:
    """With groups and times given, white noise stays mostly white and the length scales stay right."""
    X, Y, _ = planted(400, seed=9, noise=0.4)
    found = learned(X, Y, *stretches(20, 20, 0.1))
    assert (found.noise * found.correlated_share).max() < 0.3 * found.noise.min()
    np.testing.assert_allclose(found.kernel.length_scales[0, :2], [0.8, 1.6], rtol=0.25)


def test_ignoring_correlated_noise_makes_the_model_overconfident() -> None:
    """Slow noise on slow inputs: taken as white, it is underestimated by a third or more; that is why groups exist."""
    rng = np.random.default_rng(10)
    groups, times = stretches(10, 40, 0.1)
    X = np.column_stack([correlated_noise(10, 40, 0.1, 2.0, rng) for _ in range(3)])
    Y = 0.5 * np.column_stack([correlated_noise(10, 40, 0.1, 0.5, rng) for _ in range(2)])
    with_groups, without = learned(X, Y, groups, times), learned(X, Y)
    assert (without.noise < 0.67 * with_groups.noise).all()
