from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.errors import DegenerateError
from gpcorrect.gpr.kernels import AdditiveRBF, WithLinear
from gpcorrect.gpr.linalg import (
    cholesky,
    conditioned,
    conditioned_mean,
    conditioned_on_others,
    inverse_and_log_determinant,
    triangular_inverse,
)


def covariance(n: int = 8) -> np.ndarray:
    A = np.random.default_rng(0).normal(size=(n, n))
    return A @ A.T + np.eye(n)


def test_a_sound_covariance_is_factored_without_jitter() -> None:
    """L L^T is the matrix itself."""
    C = covariance()
    L, jitter = cholesky(C)
    assert jitter == 0.0
    np.testing.assert_allclose(L @ L.T, C, rtol=1e-12)


def test_a_singular_covariance_gets_the_least_jitter_that_helps_and_says_so() -> None:
    """The jitter is relative to the diagonal: a matrix a million times as large gets a million times as much."""
    C = np.ones((5, 5))
    L, jitter = cholesky(C)
    assert 0 < jitter <= 1e-10
    np.testing.assert_allclose(L @ L.T, C + jitter * np.eye(5), atol=1e-14)
    np.testing.assert_allclose(cholesky(1e6 * C)[1], 1e6 * jitter)


def test_a_matrix_that_is_no_covariance_is_refused() -> None:
    """An indefinite matrix is not hidden under jitter."""
    with pytest.raises(DegenerateError, match="not positive definite"):
        cholesky(np.diag([1.0, -1.0]))


def test_inverse_and_log_determinant_agree_with_numpy() -> None:
    """The upper triangle holds the inverse, and the caller's matrix stays as it was."""
    C = covariance()
    kept = C.copy()
    triangle, log_determinant = inverse_and_log_determinant(C)
    np.testing.assert_allclose(triangle, np.triu(np.linalg.inv(C)), atol=1e-12)
    assert log_determinant == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-12)
    np.testing.assert_array_equal(C, kept)


def test_a_triangle_times_its_inverse_is_the_identity() -> None:
    """Of a matrix that is halved more than once, too; the caller's triangle stays as it was."""
    L, _ = cholesky(covariance(301))
    kept = L.copy()
    np.testing.assert_allclose(triangular_inverse(L) @ L, np.eye(301), atol=1e-9)
    np.testing.assert_array_equal(L, kept)


def test_one_factor_leaves_out_each_fold_as_conditioning_on_the_others_does() -> None:
    """Means and deviations are those of the observations of other folds alone, also at rows of a fold without any."""
    rng = np.random.default_rng(1)
    kernel = WithLinear(AdditiveRBF(np.ones(1), np.array([[1.0, 2.0]])), np.array([1.0, 0.5]))
    X, Y, folds = rng.normal(size=(40, 2)), rng.normal(size=(40, 3)), rng.integers(0, 4, 40)
    at, left_out = rng.normal(size=(15, 2)), rng.integers(0, 5, 15)
    mean, std = conditioned_on_others(kernel, 0.01, (X, Y, folds), (at, left_out))
    for fold in range(5):
        others, here = folds != fold, left_out == fold
        expected = conditioned(kernel, 0.01, X[others], Y[others], at[here])
        np.testing.assert_allclose(mean[here], expected[0], atol=1e-9)
        np.testing.assert_allclose(std[here], expected[1], rtol=1e-8)
        mean_alone = conditioned_mean(kernel, 0.01, X[others], Y[others], at[here])
        np.testing.assert_allclose(mean_alone, expected[0], atol=1e-12)
