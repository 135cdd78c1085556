"""tinygp on JAX: exact regression, ARD kernel, L-BFGS-B with JAX's gradients; a model an output."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tinygp
from scipy.optimize import minimize

from gpcorrect.types import FloatArray
from peers.peer import Peer, Standard, subset

STEPS = 100


class Models:
    """A fitted model for each output, predictions compiled."""

    def __init__(self, X: FloatArray, Y: FloatArray, thetas: list[FloatArray], standard: Standard) -> None:
        self.X, self.Y, self.thetas, self.standard = X, Y, jnp.array(thetas), standard
        self._predict = jax.jit(jax.vmap(_predict, in_axes=(0, None, 1, None)))

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations."""
        mean, std = self._predict(self.thetas, self.X, self.Y, X)
        return self.standard.restored(np.asarray(mean).T, np.asarray(std).T)


def exact(X: FloatArray, Y: FloatArray, limit: float, *, size: int) -> tuple[Peer, str]:
    """Fit to a random subset."""
    jax.config.update("jax_enable_x64", True)
    rows, standard = subset(X, size), Standard(Y)
    inputs, outputs = X[rows], standard.scaled(Y)[rows]
    loss = jax.jit(jax.value_and_grad(_loss))
    start = np.concatenate([np.log([1.0, 0.1]), np.full(X.shape[1], np.log(3.0))])

    def objective(theta: FloatArray, y: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = loss(theta, inputs, y)
        return float(value), np.asarray(gradient, dtype=np.float64)

    options = {"maxiter": STEPS}
    thetas = [minimize(objective, start, (y,), "L-BFGS-B", jac=True, options=options).x for y in outputs.T]
    return Models(inputs, outputs, thetas, standard), ""


def _process(theta: Any, X: Any) -> Any:
    kernel = jnp.exp(theta[0]) * tinygp.transforms.Linear(jnp.exp(-theta[2:]), tinygp.kernels.ExpSquared())
    return tinygp.GaussianProcess(kernel, X, diag=jnp.exp(theta[1]))


def _loss(theta: Any, X: Any, y: Any) -> Any:
    return -_process(theta, X).log_probability(y)


def _predict(theta: Any, X: Any, y: Any, at: Any) -> tuple[Any, Any]:
    _, conditioned = _process(theta, X).condition(y, at)
    return conditioned.loc, jnp.sqrt(conditioned.variance + jnp.exp(theta[1]))
