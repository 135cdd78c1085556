"""Exact Gaussian-process regression, for sets small enough for a factorisation of their covariance."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.gpr.base import GaussianProcess
from gpcorrect.gpr.kernels import rbf
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.variances import best_ratios, exact_objective
from gpcorrect.types import FloatArray

__all__ = ["ExactGPR"]

MOST_SAMPLES = 6000  # a symmetric eigenproblem of this size takes about a minute and 1 GB on two cores


class ExactGPR(GaussianProcess):
    """Gaussian-process regression by factorisation of the full covariance (Rasmussen and Williams 2006, Alg. 2.1).

    Parameters
    ----------
    n_subset : int
        Rows that the length scales are learned on.
    n_restarts : int
        Further searches for the length scales, from random starts.
    random_state : int, RandomState or None
        Seed of the subset and the restarts.

    Attributes
    ----------
    length_scale_ : (d,) array
        Of each feature, in its own unit.
    predictor_ : Predictor
        The posterior.
    """

    most_samples = MOST_SAMPLES

    def __init__(self, n_subset: int = 1000, n_restarts: int = 0, random_state: int | None = 0) -> None:
        self.n_subset = n_subset
        self.n_restarts = n_restarts
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from inputs `(n, d)` and outputs `(n,)` or `(n, m)`.

        Raises
        ------
        DataError
            There are more samples than an exact factorisation can bear.
        """
        return self._fit(X, y, self.n_subset)

    def _posterior(self, A: FloatArray, B: FloatArray, length_scale: FloatArray, rng: np.random.Generator) -> Predictor:
        basis = A / length_scale
        R = rbf(basis, basis)
        np.fill_diagonal(R, 1.0)
        eigenvalues, Q = np.linalg.eigh(R)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        coefficients = Q.T @ B
        ratios = best_ratios(exact_objective(eigenvalues, coefficients**2), B.shape[1])
        spread = eigenvalues[:, None] + ratios
        signal = (coefficients**2 / spread).mean(axis=0)
        y_spread, y_centre = self.scaling_.y_spread, self.scaling_.y_centre
        return Predictor(
            scale=1.0 / (length_scale * self.scaling_.x_spread),
            basis=basis,
            half_squares=0.5 * (basis**2).sum(axis=1),
            alpha=((Q @ (coefficients / spread)) * y_spread).T,
            centre=y_centre,
            factor=Q.T,
            shrink=(1.0 / spread).T,
            signal=signal * y_spread**2,
            noise=signal * ratios * y_spread**2,
        )
