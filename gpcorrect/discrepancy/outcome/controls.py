"""Two yardsticks for a closed gap.

What the same fit does to shuffled trajectories, and what a black box does with the same inputs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import Bounds, minimize
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["black_box", "placebo"]

BLACK_BOX_ROWS = 400  # exact GP on a random part of the rows
RIDGE = 1e-6
ITERATIONS = 20


def black_box(inputs: FloatArray, residual: FloatArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Residual `(n,)` once a Gaussian process on the inputs `(n, d)`, fitted to the training rows, is taken off.

    Notes
    -----
    Squared-exponential kernel with one length scale an input, maximum marginal likelihood, on at most 500 rows.
    """
    spread = inputs.std(axis=0)
    x = (inputs - inputs.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    rows = np.flatnonzero(train & np.isfinite(residual))
    if len(rows) > BLACK_BOX_ROWS:
        rows = np.sort(rng.choice(rows, BLACK_BOX_ROWS, replace=False))
    size = float(np.std(residual[rows])) or 1.0
    scales = np.full(x.shape[1], 2.0)
    kernel = ConstantKernel(1.0, (1e-2, 1e3)) * RBF(scales, (1e-1, 1e3)) + WhiteKernel(0.1, (1e-6, 1e1))
    model = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0, optimizer=_short_ascent)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its bound: the input says nothing
        model.fit(x[rows], residual[rows] / size)
    left: FloatArray = residual - size * model.predict(x)
    return left


def _short_ascent(objective: Callable[..., Any], start: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
    """L-BFGS-B with few iterations: a yardstick need not be polished."""
    found = minimize(
        objective, start, jac=True, bounds=Bounds(*bounds.T), method="L-BFGS-B", options={"maxiter": ITERATIONS}
    )
    return found.x, float(found.fun)


def placebo(
    signatures: FloatArray, residual: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator
) -> FloatArray:
    """Residual `(n,)` once the effects' signatures `(n, k)`, fitted to exchanged trajectories, are taken off.

    Least squares of the signatures' sizes on a residual whose whole trajectories are dealt to the motion of others;
    nothing true can
    be learned, so what it closes is what any fit of this freedom closes.
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
