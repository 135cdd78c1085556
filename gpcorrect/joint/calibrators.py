"""Calibrators that need no path: fixed offset, linear, quadratic, network; scikit-learn estimators.

Features in, error of every joint out (reported minus true has its sign in the data set). What `fit` learned is in
`map_`, which is what a model file keeps.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.compose import TransformedTargetRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from gpcorrect.joint.maps import ErrorMap, NetworkMap, PolynomialMap, Scaler, polynomial_terms
from gpcorrect.types import FloatArray

__all__ = ["Calibrator", "NetworkCalibrator", "PolynomialCalibrator"]


class Calibrator(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # untyped
    """Regression of the joints' errors; subclasses learn a map.

    Attributes
    ----------
    map_ : ErrorMap
        What was learned.
    """

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from features `(n, d)` and errors `(n,)` or `(n, m)`."""
        inputs, outputs = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        outputs = np.asarray(outputs, dtype=np.float64)
        self._one_output = outputs.ndim == 1
        self.map_: ErrorMap = self._learn(inputs, outputs.reshape(len(outputs), -1))
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Return errors, and with `return_std` their standard deviations too, `(n,)` or `(n, m)`."""
        check_is_fitted(self, "map_")
        mean, std = self.map_.predict(validate_data(self, X, reset=False, dtype=np.float64))
        if self._one_output:
            mean, std = mean[:, 0], std[:, 0]
        return (mean, std) if return_std else mean

    @abstractmethod
    def _learn(self, X: FloatArray, Y: FloatArray) -> ErrorMap:
        """Return the map that features `(n, d)` and errors `(n, m)` teach."""


class PolynomialCalibrator(Calibrator):
    """Fixed offset (degree 0), linear (1) or second-order polynomial (2) in the features.

    Parameters
    ----------
    degree : int
        0, 1 or 2.
    ridge : float
        Of the samples, on scaled features: keeps features that move together apart.
    """

    def __init__(self, degree: int = 1, ridge: float = 1e-6) -> None:
        self.degree = degree
        self.ridge = ridge

    def _learn(self, X: FloatArray, Y: FloatArray) -> PolynomialMap:
        scaler = Scaler.of(X)
        A = polynomial_terms(scaler.apply(X), self.degree)
        penalty = self.ridge * len(A) * np.eye(A.shape[1])
        penalty[0, 0] = 0.0  # the offset is free
        weights = np.asarray(np.linalg.solve(A.T @ A + penalty, A.T @ Y), dtype=np.float64)
        std: FloatArray = (Y - A @ weights).std(axis=0)
        return PolynomialMap(self.degree, scaler, weights, std)


class NetworkCalibrator(Calibrator):
    """Network of logistic layers as in the RAVEN-II study: 2 x 100, L2 5e-4, Adam 1e-3, 200 epochs of batches of 1024.

    Parameters
    ----------
    layers : sequence of int
        Widths; (600, 500, 400) is the study's larger one.
    epochs : int
        Passes over the data.
    l2 : float
        Weight decay.
    learning_rate : float
        Of Adam.
    batch : int
        Samples a step.
    random_state : int or None
        Seed of first weights and order.
    """

    def __init__(
        self,
        layers: Sequence[int] = (100, 100),
        epochs: int = 200,
        l2: float = 5e-4,
        learning_rate: float = 1e-3,
        batch: int = 1024,
        random_state: int | None = 0,
    ) -> None:
        self.layers = layers
        self.epochs = epochs
        self.l2 = l2
        self.learning_rate = learning_rate
        self.batch = batch
        self.random_state = random_state

    def _learn(self, X: FloatArray, Y: FloatArray) -> NetworkMap:
        network = MLPRegressor(
            hidden_layer_sizes=tuple(self.layers),
            activation="logistic",
            alpha=self.l2,
            learning_rate_init=self.learning_rate,
            batch_size=min(self.batch, len(X)),
            max_iter=self.epochs,
            tol=0.0,
            n_iter_no_change=self.epochs + 1,
            random_state=self.random_state,
        )
        whole = TransformedTargetRegressor(make_pipeline(StandardScaler(), network), transformer=StandardScaler())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # the study trains for a set number of epochs
            whole.fit(X.astype(np.float32), Y.astype(np.float32))  # as deep-learning libraries do, at half the time
        fitted = whole.regressor_
        scale, inner, out = fitted[0], fitted[1], whole.transformer_
        learned = NetworkMap(
            Scaler(_double(scale.mean_), _double(scale.scale_)),
            tuple(map(_double, inner.coefs_)),
            tuple(map(_double, inner.intercepts_)),
            Scaler(_double(out.mean_), _double(out.scale_)),
            np.zeros(Y.shape[1]),
        )
        left = Y - learned.predict(X)[0]
        return NetworkMap(learned.scaler, learned.weights, learned.biases, learned.output, left.std(axis=0))


def _double(values: Any) -> FloatArray:
    return np.asarray(values, dtype=np.float64)
