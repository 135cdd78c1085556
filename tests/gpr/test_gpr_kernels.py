from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.gaussian_process.kernels import RBF, Matern

from gpcorrect.codec import pack, unpack
from gpcorrect.errors import DataError
from gpcorrect.gpr import ExactGPR, Predictor, SparseGPR, WithLinear, conditioned
from gpcorrect.gpr.kernels import KERNELS, AdditiveRBF, Kernel, _half_squares, component_masks
from gpcorrect.gpr.linalg import cholesky
from gpcorrect.types import FloatArray

EACH = pytest.mark.parametrize("kind", KERNELS.values(), ids=list(KERNELS))
PEERS = {"rbf": RBF, "matern52": partial(Matern, nu=2.5)}


def random_kernel(kind: type[Kernel], rng: np.random.Generator, d: int, c: int) -> Kernel:
    weights = rng.uniform(0.1, 1.0, c)
    return kind(weights / weights.sum(), rng.uniform(0.3, 3.0, (c, d)))


@EACH
@given(seed=st.integers(0, 2**32 - 1))
def test_a_correlation_matrix_is_symmetric_with_unit_diagonal_and_no_negative_eigenvalue(
    kind: type[Kernel], seed: int
) -> None:
    """The kernel is a correlation function whatever its parameters, and its diagonal is what it says."""
    rng = np.random.default_rng(seed)
    X = rng.normal(scale=rng.uniform(0.1, 10), size=(12, 3))
    kernel = random_kernel(kind, rng, 3, 2)
    R = kernel(X, X)
    np.testing.assert_allclose(R, R.T, atol=1e-14)
    np.testing.assert_allclose(np.diagonal(R), kernel.diagonal(X), atol=1e-12)
    assert np.linalg.eigvalsh(R).min() > -1e-12


@EACH
def test_one_component_is_the_kernel_of_scikit_learn(kind: type[Kernel]) -> None:
    """An independent implementation gives the same numbers, and the same gradient by log length scales."""
    rng = np.random.default_rng(0)
    A, B, scales = rng.normal(size=(7, 4)), rng.normal(size=(5, 4)), rng.uniform(0.2, 5, 4)
    kernel, peer = kind(np.ones(1), scales[None]), PEERS[kind.name](scales)
    np.testing.assert_allclose(kernel(A, B), peer(A, B), rtol=1e-12)
    R, pullback = kernel.with_gradient(A)
    expected, slopes = peer(A, eval_gradient=True)
    upstream = rng.normal(size=R.shape)
    upstream += upstream.T
    np.testing.assert_allclose(R, expected, rtol=1e-12)
    np.testing.assert_allclose(pullback(upstream)[0][0], np.einsum("ij,ijd->d", upstream, slopes), rtol=1e-10)


@EACH
def test_the_gradient_by_scales_and_odds_is_that_of_finite_differences(kind: type[Kernel]) -> None:
    """With several components, every derivative agrees with a central difference."""
    rng = np.random.default_rng(3)
    X, upstream = rng.normal(size=(9, 3)), np.eye(9) + 0.1
    log_scales, odds = rng.normal(size=(2, 3)), rng.normal(size=2)

    def value(theta: FloatArray) -> float:
        weights = np.exp(theta[6:])
        return float(np.vdot(upstream, kind(weights / weights.sum(), np.exp(theta[:6]).reshape(2, 3))(X, X)))

    theta = np.concatenate([log_scales.ravel(), odds])
    weights = np.exp(odds)
    _, pullback = kind(weights / weights.sum(), np.exp(log_scales)).with_gradient(X)
    numeric = [(value(theta + e) - value(theta - e)) / 2e-6 for e in 1e-6 * np.eye(8)]
    np.testing.assert_allclose(np.concatenate([part.ravel() for part in pullback(upstream)]), numeric, atol=1e-7)


@EACH
def test_the_hot_path_answers_as_the_matrices_do(kind: type[Kernel]) -> None:
    """Mean, deviation and novelty of one input, from the kernel's table, are those of many."""
    rng = np.random.default_rng(4)
    X = rng.normal(size=(60, 3))
    model = SparseGPR(30, 20, feature_groups=[(0, 1), (2,)], kernel=kind.name, n_learn=40)
    predictor = model.fit(X, np.sin(X @ rng.normal(size=(3, 2)))).predictor_
    reloaded = unpack(Predictor, *pack(predictor, "predictor"))
    assert all(type(part.kernel) is kind for part in reloaded.parts)
    queries = np.vstack([3 * rng.normal(size=(20, 3)), X[:20]])
    for one, many in zip(
        zip(*map(reloaded.mean_std, queries), strict=True), predictor.mean_std_batch(queries), strict=True
    ):
        np.testing.assert_allclose(one, many, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("kind", ["rbf", "matern52"])
def test_auto_takes_the_kernel_of_greater_evidence(kind: str) -> None:
    """Of a field drawn from one of the kernels, the evidence says which."""
    rng = np.random.default_rng(5)
    X = rng.uniform(-3, 3, (300, 1))
    L, _ = cholesky(KERNELS[kind](np.ones(1), np.ones((1, 1)))(X, X))
    Y = L @ rng.normal(size=(300, 6)) + 0.01 * rng.normal(size=(300, 6))
    (learned,) = ExactGPR(kernel="auto", n_learn=300).fit(X, Y).learned_
    assert learned.kernel.name == kind


def test_a_kernel_that_does_not_exist_is_refused() -> None:
    """The error lists those that do."""
    with pytest.raises(DataError, match="one of rbf, matern52"):
        ExactGPR(kernel="linear").fit(np.eye(3), np.eye(3))  # type: ignore[arg-type]


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
    assert _half_squares(X, X).max() <= 0.0


def test_a_line_beside_a_kernel_runs_on_past_the_data_and_so_does_its_doubt() -> None:
    """Seen on a line, a field goes on along it where the kernel alone falls back to zero, and its deviation grows."""
    x, far = np.linspace(-1.0, 1.0, 20)[:, None], np.array([[3.0], [6.0]])
    bend = AdditiveRBF(np.ones(1), np.ones((1, 1)))
    kernel = WithLinear(bend, np.ones(1))
    np.testing.assert_allclose(np.diag(kernel(x, x)), kernel.diagonal(x), rtol=1e-12)
    mean, deviation = conditioned(kernel, 1e-2, x, 0.5 + 2.0 * x, far)
    alone, _ = conditioned(bend, 1e-2, x, 0.5 + 2.0 * x, far)
    assert (mean > 0.7 * (0.5 + 2.0 * far)).all()  # the bend explains a part of what was seen
    assert abs(alone[1, 0]) < 0.1
    assert deviation[1] > deviation[0] > conditioned(kernel, 1e-2, x, 2.0 * x, np.zeros((1, 1)))[1][0]
