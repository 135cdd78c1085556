"""GPy: exact and sparse regression (Titsias 2009), ARD kernel, L-BFGS-B; all outputs share a kernel and a noise."""

from __future__ import annotations

import time
from typing import Any

import GPy
import numpy as np

from gpcorrect.types import FloatArray
from peers.peer import Peer, Standard, subset

STEPS = 100
AT_ONCE = 5  # steps between looks at the clock


class Model:
    """One model of all outputs."""

    def __init__(self, model: Any, standard: Standard) -> None:
        self.model, self.standard = model, standard

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations."""
        mean, variance = self.model.predict(X)
        return self.standard.restored(mean, np.sqrt(variance) * np.ones(mean.shape))


def exact(X: FloatArray, Y: FloatArray, limit: float, *, size: int) -> tuple[Peer, str]:
    """Fit to a random subset."""
    rows, standard = subset(X, size), Standard(Y)
    return _fit(GPy.models.GPRegression(X[rows], standard.scaled(Y)[rows], _kernel(X)), standard, limit)


def sparse(X: FloatArray, Y: FloatArray, limit: float, *, inducing: int) -> tuple[Peer, str]:
    """Fit to all samples through inducing points that start at random samples and are learned."""
    standard, points = Standard(Y), np.array(X[subset(X, inducing)])
    return _fit(GPy.models.SparseGPRegression(X, standard.scaled(Y), _kernel(X), Z=points), standard, limit)


def _kernel(X: FloatArray) -> Any:
    return GPy.kern.RBF(X.shape[1], ARD=True, lengthscale=3.0)


def _fit(model: Any, standard: Standard, limit: float) -> tuple[Peer, str]:
    start, done, last = time.process_time(), 0, -np.inf
    while done < STEPS and time.process_time() - start < limit and model.log_likelihood() - last > 1e-3 * AT_ONCE:
        last = model.log_likelihood()
        model.optimize("lbfgsb", max_iters=AT_ONCE)
        done += AT_ONCE
    return Model(model, standard), f"{done} of {STEPS} steps"
