"""Where the inducing points go: at samples drawn in proportion to what the points chosen so far leave unexplained.

Randomly pivoted Cholesky (Chen, Epperly, Tropp and Webber 2023) in blocks with rejection (Epperly, Tropp and Webber
2024): the same law as drawing one at a time, at the speed of matrix products. Unlike the greedy choice it does not
chase outliers, unlike k-means it never puts two points where one will do, so the covariance of the points stays well
conditioned; and any first part of the points is itself a sound choice, which the predictor makes use of.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.linalg import cholesky
from gpcorrect.types import FloatArray, IntArray

__all__ = ["choose_inducing"]

CANDIDATES_PER_POINT = 5
FEWEST_CANDIDATES = 4096
BLOCK = 64
TOLERANCE = 1e-7  # of the prior variance: a sample explained to this is the same point to rounding


def choose_inducing(kernel: AdditiveRBF, X: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Return at most `count` rows of `X` `(n, d)` as inducing points; fewer when they explain all the others.

    Parameters
    ----------
    kernel : AdditiveRBF
        In the units of X.
    X : (n, d) array
        Training inputs; a random part of them are candidates.
    count : int
        Points wanted.
    rng : numpy.random.Generator
        Source of the draws.
    """
    candidates = X[rng.permutation(len(X))[: max(CANDIDATES_PER_POINT * count, FEWEST_CANDIDATES)]]
    count = min(count, len(candidates))
    factor, left, chosen = np.empty((count, len(candidates))), np.ones(len(candidates)), np.empty(0, dtype=np.int64)
    while len(chosen) < count and left.max() > TOLERANCE:
        found = factor[: len(chosen)]
        batch = np.unique(rng.choice(len(left), min(BLOCK, count - len(chosen)), p=left / left.sum()))
        batch = rng.permutation(batch)
        inner = kernel(candidates[batch], candidates[batch]) - found[:, batch].T @ found[:, batch]
        kept = _thin(inner, rng)
        rows = batch[kept]
        cross = kernel(candidates[rows], candidates) - found[:, rows].T @ found
        new = solve_triangular(cholesky(inner[np.ix_(kept, kept)])[0], cross, lower=True, check_finite=False)
        factor[len(chosen) : len(chosen) + len(rows)] = new
        left = np.maximum(left - np.einsum("in,in->n", new, new), 0.0)
        left[rows] = 0.0
        chosen = np.concatenate([chosen, rows])
    points: FloatArray = candidates[chosen]
    return points


def _thin(residual: FloatArray, rng: np.random.Generator) -> IntArray:
    """Keep of a block what drawing one at a time would: each with the share of its variance that is still left."""
    left = np.array(residual)
    thresholds = np.maximum(np.diagonal(residual) * rng.random(len(residual)), TOLERANCE)
    kept: list[int] = []
    for i, threshold in enumerate(thresholds):
        if left[i, i] > threshold or not kept:
            kept.append(i)
            column = left[:, i] / np.sqrt(max(left[i, i], TOLERANCE))
            left -= np.outer(column, column)
    return np.array(kept, dtype=np.int64)
