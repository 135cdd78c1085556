from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.gaussian_process.kernels import RBF

from gpcorrect.errors import DataError
from gpcorrect.gpr.kernels import AdditiveRBF, component_masks, squared_distances


def random_kernel(rng: np.random.Generator, d: int, c: int) -> AdditiveRBF:
    weights = rng.uniform(0.1, 1.0, c)
    return AdditiveRBF(weights / weights.sum(), rng.uniform(0.3, 3.0, (c, d)))


@given(st.integers(0, 2**32 - 1))
def test_a_correlation_matrix_is_symmetric_with_unit_diagonal_and_no_negative_eigenvalue(seed: int) -> None:
    """The kernel is a correlation function whatever its parameters."""
    rng = np.random.default_rng(seed)
    X = rng.normal(scale=rng.uniform(0.1, 10), size=(12, 3))
    R = random_kernel(rng, 3, 2)(X, X)
    np.testing.assert_allclose(R, R.T, atol=1e-14)
    np.testing.assert_allclose(np.diagonal(R), 1.0, atol=1e-12)
    assert np.linalg.eigvalsh(R).min() > -1e-12


def test_one_component_is_the_ard_kernel_of_scikit_learn() -> None:
    """An independent implementation gives the same numbers."""
    rng = np.random.default_rng(0)
    A, B, scales = rng.normal(size=(7, 4)), rng.normal(size=(5, 4)), rng.uniform(0.2, 5, 4)
    np.testing.assert_allclose(AdditiveRBF(np.ones(1), scales[None])(A, B), RBF(scales)(A, B), rtol=1e-12)


def test_an_infinite_length_scale_makes_a_feature_invisible() -> None:
    """A component does not see what it has an infinite length scale for."""
    rng = np.random.default_rng(1)
    kernel = AdditiveRBF(np.ones(1), np.array([[1.0, np.inf]]))
    A = rng.normal(size=(6, 2))
    B = np.column_stack([A[:, 0], rng.normal(scale=100.0, size=6)])
    np.testing.assert_allclose(kernel(A, A), kernel(A, B))


def test_masks_hold_each_group_and_then_all_features() -> None:
    """Groups come first; a group of everything or nothing adds no component."""
    np.testing.assert_array_equal(component_masks(3, [(0, 1), (2,)]), [[1, 1, 0], [0, 0, 1], [1, 1, 1]])
    np.testing.assert_array_equal(component_masks(2, [(0, 1), ()]), [[1, 1]])
    np.testing.assert_array_equal(component_masks(2, None), [[1, 1]])


def test_a_group_of_features_that_do_not_exist_is_refused() -> None:
    """The error names the group and the number of features."""
    with pytest.raises(DataError, match=r"\(1, 2\).*2 features"):
        component_masks(2, [(1, 2)])


def test_squared_distances_of_far_away_twins_are_not_negative() -> None:
    """Rounding of large coordinates never makes a distance imaginary."""
    X = np.random.default_rng(2).normal(size=(20, 3)) * 1e-8 + 1e3
    assert squared_distances(X, X).min() >= 0.0
