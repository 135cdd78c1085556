"""A feed-forward network of logistic layers, as in the RAVEN-II studies."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted, fitted
from gpcorrect.calibration.learners.polynomial import Scaler
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.types import FloatArray, Progress

L2, LEARNING_RATE, BATCH = 5e-4, 1e-3, 1024
"""Weight decay, step of Adam and samples a step (Peng et al., joint-level calibration, network of 2 x 100)."""


@dataclass(frozen=True, eq=False)
class NetworkMap:
    """Logistic layers and a linear last one, between scaled inputs and scaled targets."""

    scaler: Scaler  # of the inputs
    # of each layer
    weights: tuple[FloatArray, ...]
    biases: tuple[FloatArray, ...]
    output: Scaler  # of the targets
    std: FloatArray  # (m,) standard deviation of what is left in training
    extrapolates: ClassVar[bool] = True

    @classmethod
    def fit(cls, X: FloatArray, Y: FloatArray, layers: tuple[int, ...], epochs: int, seed: int) -> Self:
        """Train.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and targets
        layers : tuple of int
            Widths; (600, 500, 400) is the larger network of Peng et al. 2020, whose batch normalisation scikit-learn
            does not have: scaled inputs and outputs and weight decay take its place.
        epochs : int, passes over the data
        seed : int, of first weights and order
        """
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.neural_network import MLPRegressor

        scaler, output = Scaler.of(X), Scaler.of(Y)
        network = MLPRegressor(
            hidden_layer_sizes=layers,
            activation="logistic",
            alpha=L2,
            learning_rate_init=LEARNING_RATE,
            batch_size=min(BATCH, len(X)),
            max_iter=epochs,
            tol=0.0,
            n_iter_no_change=epochs + 1,
            random_state=seed,
        )
        targets = output.apply(Y)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # the study trains for a set number of epochs
            # In single precision, as deep-learning libraries do, at half the time.
            network.fit(
                scaler.apply(X).astype(np.float32),
                (targets[:, 0] if targets.shape[1] == 1 else targets).astype(np.float32),
            )
        weights, biases = (
            tuple(np.asarray(part, dtype=np.float64) for part in parts)
            for parts in (network.coefs_, network.intercepts_)
        )
        learned = cls(scaler, weights, biases, output, np.zeros(Y.shape[1]))
        return cls(scaler, weights, biases, output, (Y - learned.predict(X)[0]).std(axis=0))

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`."""
        layer = self.scaler.apply(X)
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            layer = 0.5 * (1.0 + np.tanh(0.5 * (layer @ W + b)))
        mean = (layer @ self.weights[-1] + self.biases[-1]) * self.output.spread + self.output.centre
        return mean, np.broadcast_to(self.std, mean.shape), np.zeros(len(X))


def learn_network(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`NetworkMap`; one fold is left out, for training takes long."""
    layers, epochs, seed = settings.layers, settings.epochs, settings.seed
    return fitted(lambda part: NetworkMap.fit(*part.learnable(), layers, epochs, seed), samples, 1)
