"""The covariance between inputs: a squared exponential with a length scale for every feature (ARD)."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

__all__ = ["rbf", "squared_distances"]


def squared_distances(A: FloatArray, B: FloatArray) -> FloatArray:
    """Squared Euclidean distances `(n, m)` between the rows of `A` (n, d) and `B` (m, d), never below zero."""
    squares = (A * A).sum(axis=1)[:, None] + (B * B).sum(axis=1)[None, :] - 2.0 * (A @ B.T)
    return np.maximum(squares, 0.0, out=squares)


def rbf(A: FloatArray, B: FloatArray) -> FloatArray:
    """Correlations `exp(-|a - b|^2 / 2)` `(n, m)` of inputs that are already divided by their length scales."""
    squares = squared_distances(A, B)
    squares *= -0.5
    correlation: FloatArray = np.exp(squares, out=squares)
    return correlation
