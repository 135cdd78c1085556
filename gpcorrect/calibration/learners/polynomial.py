"""Fixed offset, linear law and second-order polynomial: the simple learners, and the law before a Gaussian process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted, fitted
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, Progress

RIDGE = 1e-6
"""Penalty on squared weights, of the samples and for unit spreads: keeps columns that move together apart; by hand."""


@dataclass(frozen=True, eq=False)
class Scaler:
    """Shift and spread of columns: `(x - centre) / spread`."""

    centre: FloatArray
    spread: FloatArray

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Return mean and standard deviation of `values` (n, d); a constant column keeps spread 1.

        Parameters
        ----------
        values : (n, d) array, columns to be scaled
        """
        spread = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(spread > 0, spread, 1.0))

    def apply(self, values: FloatArray) -> FloatArray:
        """Return scaled values `(..., d)`.

        Parameters
        ----------
        values : (..., d) array, in the units of the training
        """
        return (values - self.centre) / self.spread


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Polynomial of degree 0, 1 or 2 in scaled inputs; its standard deviation is that of the training residuals."""

    degree: int  # 0, 1 or 2
    scaler: Scaler  # of the inputs
    weights: FloatArray  # (terms, m) of 1, the inputs, and their products
    std: FloatArray  # (m,) of what is left in training
    extrapolates: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.weights.ndim != 2 or self.std.shape != self.weights.shape[1:]:
            raise DataError(f"weights {self.weights.shape} of a law do not fit deviations {self.std.shape}.")

    @classmethod
    def fit(
        cls,
        X: FloatArray,
        Y: FloatArray,
        degree: int,
        penalties: FloatArray | None = None,
        scaler: Scaler | None = None,
    ) -> Self:
        """Return the ridge regression of targets on inputs.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and targets
        degree : int, 0, 1 or 2
        penalties : (d, m) array, optional
            Penalties on squared weights of a linear law, in units of the samples and for unit spreads.
        scaler : Scaler, optional, says what unit spreads are; those of these inputs without it
        """
        scaler = scaler or Scaler.of(X)
        A = _terms(scaler.apply(X), degree)
        if penalties is None:
            penalties = np.full((A.shape[1] - 1, Y.shape[1]), RIDGE)
        gram, right = A.T @ A, A.T @ Y
        weights = np.empty(right.shape)
        for j, penalty in enumerate(penalties.T):  # the offset is free
            weights[:, j] = np.linalg.solve(gram + len(A) * np.diag(np.append(0.0, penalty)), right[:, j])
        return cls(degree, scaler, weights, (Y - A @ weights).std(axis=0))

    def mean(self, X: FloatArray) -> FloatArray:
        """Return means `(n, m)` at inputs `(n, d)`.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        scaled = self.scaler.apply(X)
        if self.degree == 1:  # as below, without another copy of the inputs
            return np.asarray(self.weights[0] + scaled @ self.weights[1:])
        return _terms(scaled, self.degree) @ self.weights

    def weights_under(self, scaler: Scaler) -> FloatArray:
        """Return the weights `(1 + d, m)` of the same linear law in inputs scaled otherwise.

        Parameters
        ----------
        scaler : Scaler, of the inputs
        """
        first, others = self.weights[0], self.weights[1:]
        shifted = first + self.scaler.apply(scaler.centre) @ others
        return np.vstack([shifted, (scaler.spread / self.scaler.spread)[:, None] * others])

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`."""
        mean = self.mean(X)
        return mean, np.broadcast_to(self.std, mean.shape), np.zeros(len(X))


def learn_polynomial(
    degree: int, samples: Samples, layout: Layout, settings: FitSettings, progress: Progress
) -> Fitted:
    """Learn a :class:`PolynomialMap`.

    Parameters
    ----------
    degree : int, 0, 1 or 2
    samples, layout, settings, progress
        See :data:`Learner`.
    """
    return fitted(lambda part: PolynomialMap.fit(*part.learnable(), degree), samples, LIMITS.folds)


def _terms(X: FloatArray, degree: int) -> FloatArray:
    """Return 1, then the columns, then their products `(n, terms)`, up to `degree`."""
    parts = [np.ones((len(X), 1))]
    if degree >= 1:
        parts.append(X)
    if degree >= 2:
        i, j = np.triu_indices(X.shape[1])
        parts.append(X[:, i] * X[:, j])
    return np.hstack(parts)
