"""Length scales by maximum marginal likelihood: shared by all outputs, each of which has its own signal and noise variance.

The signal and noise variances sit at their best for every choice of length scales, so only the length scales are searched and the
envelope theorem makes their gradient exact: `d/dtheta = tr[(sum_o C_o^-1 - a_o a_o^T / s_o) dR/dtheta] / 2` with `C_o = R + delta_o I`
and `a_o = C_o^-1 y_o` (Rasmussen and Williams 2006, Eq. 5.9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from gpcorrect.gpr.kernels import rbf
from gpcorrect.gpr.variances import best_ratios, exact_objective
from gpcorrect.types import FloatArray

__all__ = ["Hyperparameters", "learn_length_scales", "profile_likelihood"]

SHORTEST, LONGEST = 0.05, 100.0  # in units of the spread of a feature: shorter is noise, longer is a feature that does not matter
MOST_STEPS = 60
TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """What the likelihood decides.

    Parameters
    ----------
    length_scale : (d,) array
        Of each feature, in units of the scaled inputs.
    objective : float
        Negative log marginal likelihood summed over outputs, up to a constant.
    evaluations : int
        Evaluations of the likelihood that were spent.
    """

    length_scale: FloatArray
    objective: float
    evaluations: int


def profile_likelihood(log_scales: FloatArray, X: FloatArray, Y: FloatArray) -> tuple[float, FloatArray]:
    """Negative log marginal likelihood of all outputs, variances at their best, and its gradient.

    Parameters
    ----------
    log_scales : (d,) array
        Logarithms of the length scales.
    X : (n, d) array
        Scaled inputs.
    Y : (n, m) array
        Centred outputs of unit spread.

    Returns
    -------
    value : float
    gradient : (d,) array
        With respect to `log_scales`.
    """
    A = X / np.exp(log_scales)
    R = rbf(A, A)
    np.fill_diagonal(R, 1.0)
    eigenvalues, Q = np.linalg.eigh(R)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    coefficients = Q.T @ Y
    objective = exact_objective(eigenvalues, coefficients**2)
    ratios = best_ratios(objective, Y.shape[1])
    spread = eigenvalues[:, None] + ratios
    signal = np.maximum((coefficients**2 / spread).mean(axis=0), 1e-300)
    weights = Q @ (coefficients / spread)
    slope = 0.5 * ((Q * (1.0 / spread).sum(axis=1)) @ Q.T - (weights / signal) @ weights.T) * R
    # sum_ij slope_ij (a_i - a_j)^2 by feature, without forming the n x n x d differences
    gradient = 2.0 * ((slope.sum(axis=1)[:, None] * A * A).sum(axis=0) - np.einsum("nd,nd->d", A, slope @ A))
    return float(objective(ratios[None]).sum()), gradient


def learn_length_scales(X: FloatArray, Y: FloatArray, restarts: int, rng: np.random.Generator) -> Hyperparameters:
    """Return the best of `1 + restarts` searches by L-BFGS-B, the first from a length scale of sqrt(d) everywhere.

    Parameters
    ----------
    X, Y : (n, d) and (n, m) arrays
        As for :func:`profile_likelihood`.
    restarts : int
        Further searches from random starts.
    rng : Generator
        Source of the random starts.
    """
    d = X.shape[1]
    bounds = [(np.log(SHORTEST), np.log(LONGEST))] * d
    first = np.full(d, 0.5 * np.log(d) + np.log(1.5))
    starts = [first, *(first + rng.normal(0.0, 0.7, d) for _ in range(restarts))]
    results = [
        minimize(
            profile_likelihood,
            start,
            args=(X, Y),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": MOST_STEPS, "ftol": TOLERANCE},
        )
        for start in starts
    ]
    best = min(results, key=lambda result: float(result.fun))
    return Hyperparameters(np.exp(best.x), float(best.fun), sum(int(r.nfev) for r in results))
