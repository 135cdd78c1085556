"""Signal and noise variance of every output at once, given the spectrum of its covariance: one dimension each, in closed form but one.

With covariance `s (R + delta I)` and R = Q diag(lambda) Q^T the likelihood of an output needs only its squared coefficients `(Q^T y)^2`.
For a noise-to-signal ratio delta the best s is in closed form (Rasmussen and Williams 2006, Sec. 5.4), so one number is left to search.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpcorrect.types import FloatArray

__all__ = ["LARGEST_RATIO", "SMALLEST_RATIO", "best_ratios", "exact_objective"]

SMALLEST_RATIO, LARGEST_RATIO = 1e-6, 1e4
COARSE, FINE, ROUNDS = 41, 21, 3

Objective = Callable[[FloatArray], FloatArray]


def best_ratios(objective: Objective, outputs: int) -> FloatArray:
    """Noise-to-signal ratios `(outputs,)` that minimise `objective`, by a grid that is refined around its best point.

    Parameters
    ----------
    objective : callable
        Takes candidate ratios `(k, outputs)` and returns the objective of each `(k, outputs)`.
    outputs : int
        Number of outputs, searched independently.
    """
    low, high = np.log(SMALLEST_RATIO), np.log(LARGEST_RATIO)
    logs = np.repeat(np.linspace(low, high, COARSE)[:, None], outputs, axis=1)
    columns = np.arange(outputs)
    for _ in range(ROUNDS):
        best = logs[objective(np.exp(logs)).argmin(axis=0), columns]
        step = logs[1] - logs[0]
        logs = np.clip(best + np.linspace(-1, 1, FINE)[:, None] * step, low, high)
    ratios: FloatArray = np.exp(logs[objective(np.exp(logs)).argmin(axis=0), columns])
    return ratios


def exact_objective(eigenvalues: FloatArray, squared: FloatArray) -> Objective:
    """Negative log marginal likelihood, up to a constant, with the signal variance at its best.

    Parameters
    ----------
    eigenvalues : (n,) array
        Spectrum of the correlation matrix.
    squared : (n, outputs) array
        Squared coefficients of the outputs in its eigenbasis.
    """
    n = len(eigenvalues)

    def objective(ratios: FloatArray) -> FloatArray:
        spread = eigenvalues[:, None, None] + ratios
        signal = (squared[:, None, :] / spread).mean(axis=0)
        value: FloatArray = 0.5 * (n * np.log(np.maximum(signal, 1e-300)) + np.log(spread).sum(axis=0))
        return value

    return objective
