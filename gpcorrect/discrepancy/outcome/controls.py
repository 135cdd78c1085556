"""Two yardsticks for a closed gap.

What the same fit does to shuffled trajectories, and what a black box does with the same inputs.
"""

from __future__ import annotations

import numpy as np

from gpcorrect.gpr import ExactGPR
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["black_box", "placebo"]

BLACK_BOX_ROWS = 400  # exact GP on a random part of the rows
RIDGE = 1e-6


def black_box(inputs: FloatArray, residual: FloatArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Residual `(n,)` once a Gaussian process on the inputs `(n, d)`, fitted to the training rows, is taken off.

    Notes
    -----
    The package's own exact process: squared-exponential kernel with one length scale an input, on at most 400 rows.
    """
    rows = np.flatnonzero(train & np.isfinite(residual))
    if len(rows) > BLACK_BOX_ROWS:
        rows = np.sort(rng.choice(rows, BLACK_BOX_ROWS, replace=False))
    model = ExactGPR(n_learn=BLACK_BOX_ROWS).fit(inputs[rows], residual[rows])
    left: FloatArray = residual - model.predict(inputs)
    return left


def placebo(
    signatures: FloatArray, residual: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator
) -> FloatArray:
    """Residual `(n,)` once the effects' signatures `(n, k)`, fitted to exchanged trajectories, are taken off.

    Least squares of the signatures' sizes on a residual whose whole trajectories are dealt to the motion of others;
    nothing true can be learned, so what it closes is what any fit of this freedom closes.
    """
    shuffled = _shuffled(residual, block, train, rng)
    rows = train & np.isfinite(shuffled)
    x = signatures[rows]
    energy = np.diag(x.T @ x) + 1e-300
    sizes = np.linalg.solve(x.T @ x + RIDGE * np.diag(energy), x.T @ shuffled[rows])
    left: FloatArray = residual - signatures @ sizes
    return left


def _shuffled(residual: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Residual with the training blocks' contents dealt around, signs drawn; a shorter one is repeated."""
    numbers = np.unique(block[train])
    dealt = np.roll(rng.permutation(numbers), 0)
    result = np.full(len(residual), np.nan)
    for here, there in zip(numbers, np.roll(dealt, 1), strict=True):
        rows = np.flatnonzero(block == here)
        result[rows] = rng.choice([-1.0, 1.0]) * np.resize(residual[block == there], len(rows))
    return result
