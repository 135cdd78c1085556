from __future__ import annotations

import numpy as np

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.sparse import choose_inducing

KERNEL = AdditiveRBF(np.ones(1), np.full((1, 3), 1.5))


def unexplained(points: np.ndarray, X: np.ndarray) -> float:
    K = KERNEL(points, points) + 1e-10 * np.eye(len(points))
    cross = KERNEL(points, X)
    return float(1.0 - np.einsum("mn,mn->n", cross, np.linalg.solve(K, cross)).mean())


def test_inducing_points_are_distinct_training_samples() -> None:
    """Nothing is invented and nothing taken twice, even when every sample comes five times."""
    X = np.repeat(np.random.default_rng(0).normal(size=(60, 3)), 5, axis=0)
    points = choose_inducing(KERNEL, X, 50, np.random.default_rng(1))
    assert len(np.unique(points, axis=0)) == len(points) == 50
    assert {tuple(p) for p in points} <= {tuple(x) for x in X}


def test_no_more_points_are_taken_than_there_is_to_explain() -> None:
    """Ten different samples need ten points, however many were asked for."""
    X = np.tile(np.random.default_rng(0).normal(size=(10, 3)), (30, 1))
    assert len(choose_inducing(KERNEL, X, 100, np.random.default_rng(1))) == 10


def test_chosen_points_explain_more_than_as_many_random_samples() -> None:
    """On unevenly spread data the choice leaves less variance than chance does, in whole and in its first half."""
    rng = np.random.default_rng(2)
    X = np.concatenate([rng.normal(scale=0.2, size=(900, 3)), rng.normal(scale=2.0, size=(100, 3))])
    points = choose_inducing(KERNEL, X, 60, np.random.default_rng(3))
    chance = X[rng.permutation(1000)]
    assert unexplained(points, X) < 0.5 * unexplained(chance[:60], X)
    assert unexplained(points[:30], X) < 0.7 * unexplained(chance[:30], X)
