"""What the exact and the sparse regressor share: checked input, scaling, hyperparameters from a subset, prediction."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from gpcorrect.errors import DataError
from gpcorrect.gpr.likelihood import learn_length_scales
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.types import FloatArray

__all__ = ["GaussianProcess", "Scaling"]


@dataclass(frozen=True, eq=False)
class Scaling:
    """Centre and spread of inputs and outputs; a column that does not vary keeps its unit."""

    x_spread: FloatArray
    y_centre: FloatArray
    y_spread: FloatArray

    @classmethod
    def of(cls, X: FloatArray, Y: FloatArray) -> Self:
        """Scaling that gives the columns of `X` (n, d) and `Y` (n, m) unit spread."""
        return cls(_spread(X), Y.mean(axis=0), _spread(Y))


def _spread(values: FloatArray) -> FloatArray:
    spread = values.std(axis=0)
    flat = spread <= 1e-12 * np.maximum(np.abs(values).max(axis=0), 1e-300)
    return np.where(flat, 1.0, spread)


class GaussianProcess(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn is untyped
    """A Gaussian process with shared length scales and a signal and a noise variance for every output.

    Subclasses say how the posterior is found from scaled data and length scales.
    """

    most_samples: int | None = None  # that the posterior can bear; None for any number

    def _fit(self, X: ArrayLike, y: ArrayLike, samples: int) -> Self:
        """Validate, learn length scales on at most `samples` rows, and find the posterior of all rows."""
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        if self.most_samples is not None and len(X) > self.most_samples:
            raise DataError(f"exact regression takes at most {self.most_samples} samples, got {len(X)}.", hint="Use SparseGPR.")
        Y = np.asarray(y, dtype=np.float64)
        self._one_output = Y.ndim == 1
        Y = Y[:, None] if self._one_output else Y
        self.scaling_ = Scaling.of(X, Y)
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        A, B = self._scaled(X, Y)
        rows = rng.permutation(len(A))[:samples]
        found = learn_length_scales(A[rows], B[rows], self.n_restarts, rng)
        self.length_scale_ = found.length_scale * self.scaling_.x_spread
        self.predictor_ = self._posterior(A, B, found.length_scale, rng)
        return self

    def refit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Return a copy with the same length scales and scaling, fitted to other data of the same kind."""
        check_is_fitted(self, "predictor_")
        other = type(self)(**self.get_params())
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in ("predictor_",)})
        X, y = validate_data(other, X, y, reset=False, multi_output=True, y_numeric=True, dtype=np.float64)
        A, B = self._scaled(X, np.asarray(y, dtype=np.float64).reshape(len(X), -1))
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        other.predictor_ = other._posterior(A, B, self.length_scale_ / self.scaling_.x_spread, rng)
        return other

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Return the mean, and with `return_std` also the standard deviation of a new observation.

        Parameters
        ----------
        X : (n, d) array
            Inputs.
        return_std : bool
            Whether to return standard deviations too.

        Returns
        -------
        mean : (n,) or (n, m) array
        std : (n,) or (n, m) array
            Only with `return_std`.
        """
        check_is_fitted(self, "predictor_")
        X = validate_data(self, X, reset=False, dtype=np.float64)
        mean, std, _ = self.predictor_.mean_std_batch(X)
        if self._one_output:
            mean, std = mean[:, 0], std[:, 0]
        return (mean, std) if return_std else mean

    def _scaled(self, X: FloatArray, Y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return X / self.scaling_.x_spread, (Y - self.scaling_.y_centre) / self.scaling_.y_spread

    @abstractmethod
    def _posterior(self, A: FloatArray, B: FloatArray, length_scale: FloatArray, rng: np.random.Generator) -> Predictor:
        """Predictor of scaled inputs `A` (n, d) and outputs `B` (n, m)."""
