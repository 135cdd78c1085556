"""What a calibrator has learned, as numbers: features in, error out; frozen, and made to be stored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpcorrect.types import FloatArray

__all__ = ["ErrorMap", "NetworkMap", "PolynomialMap", "Scaler"]


class ErrorMap(Protocol):
    """Predicts the error of every joint, and how sure it is."""

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations `(n, m)` for features `(n, d)`."""
        ...


@dataclass(frozen=True, eq=False)
class Scaler:
    """Shift and spread of columns: `(x - centre) / spread`."""

    centre: FloatArray
    spread: FloatArray

    @classmethod
    def of(cls, values: FloatArray) -> Scaler:
        """Return mean and standard deviation; a constant column keeps spread 1."""
        spread = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(spread > 0, spread, 1.0))

    def apply(self, values: FloatArray) -> FloatArray:
        """Return scaled values."""
        scaled: FloatArray = (values - self.centre) / self.spread
        return scaled


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Polynomial of degree 0, 1 or 2 in scaled features; its standard deviation is that of the training residuals."""

    degree: int
    scaler: Scaler
    weights: FloatArray
    std: FloatArray

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`ErrorMap`."""
        mean = polynomial_terms(self.scaler.apply(X), self.degree) @ self.weights
        return mean, np.broadcast_to(self.std, mean.shape)


@dataclass(frozen=True, eq=False)
class NetworkMap:
    """Feed-forward network of logistic layers and a linear last one, between scaled features and scaled errors."""

    scaler: Scaler
    weights: tuple[FloatArray, ...]
    biases: tuple[FloatArray, ...]
    output: Scaler
    std: FloatArray

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`ErrorMap`."""
        layer = self.scaler.apply(X)
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            layer = 0.5 * (1.0 + np.tanh(0.5 * (layer @ W + b)))
        mean = (layer @ self.weights[-1] + self.biases[-1]) * self.output.spread + self.output.centre
        return mean, np.broadcast_to(self.std, mean.shape)


def polynomial_terms(X: FloatArray, degree: int) -> FloatArray:
    """Return 1, then the columns, then their products `(n, terms)`, up to `degree`."""
    parts = [np.ones((len(X), 1))]
    if degree >= 1:
        parts.append(X)
    if degree >= 2:
        i, j = np.triu_indices(X.shape[1])
        parts.append(X[:, i] * X[:, j])
    return np.hstack(parts)
