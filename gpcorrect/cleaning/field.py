"""The core of the smooth error model: kernel regression with a trend, and what it leaves unexplained."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.spatial.distance import cdist

from gpcorrect.types import FloatArray

__all__ = ["ErrorField", "Kernel"]


@dataclass(frozen=True)
class Kernel:
    """Covariance of the error at two inputs: `1 + x.x' + exp(-|x-x'|^2 / 2 l^2)`, and noise at one.

    Parameters
    ----------
    length : float
        l, in spreads of the pose inputs.
    noise : float
        Variance that pose and velocity do not explain (noise, play), over that of the bump.
    velocity : float
        Weight of the velocity inputs beside the pose's.
    """

    length: float = 2.0
    noise: float = 0.03
    velocity: float = 1.0

    def inputs(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Join pose inputs (n, d) and velocity inputs (n, k) in their weights."""
        return np.hstack([pose, self.velocity * velocity])

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Covariance (n, m) of the error at inputs x (n, d) and y (m, d), without noise."""
        covariance: FloatArray = 1.0 + x @ y.T + np.exp(-0.5 * cdist(x, y, "sqeuclidean") / self.length**2)
        return covariance

    def variance(self, x: FloatArray) -> FloatArray:
        """Variance (n,) of the error at inputs x (n, d), without noise."""
        own: FloatArray = 2.0 + (x**2).sum(axis=1)
        return own


@dataclass(frozen=True, eq=False)
class ErrorField:
    """Regression of scaled errors on inputs (a Gaussian process with a fixed kernel).

    Parameters
    ----------
    inputs : (m, d) array
        Where errors were seen.
    errors : (m, k) array
        What they were, in units of their own spread.
    kernel : Kernel
        Covariance.
    """

    inputs: FloatArray
    errors: FloatArray
    kernel: Kernel

    @cached_property
    def _solved(self) -> tuple[FloatArray, FloatArray]:
        covariance = self.kernel(self.inputs, self.inputs) + self.kernel.noise * np.eye(len(self.inputs))
        lower = cholesky(covariance, lower=True)
        return lower, cho_solve((lower, True), self.errors)

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Error (n, k) expected at inputs (n, d), and standard deviation (n,) of one about it: 1 is the noise's own.

        Far from anything seen the deviation is large, so that ignorance does not condemn a sample.
        """
        lower, weights = self._solved
        cross = self.kernel(inputs, self.inputs)
        explained = (solve_triangular(lower, cross.T, lower=True) ** 2).sum(axis=0)
        unexplained = np.maximum(self.kernel.variance(inputs) - explained, 0.0)
        return cross @ weights, np.sqrt(1.0 + unexplained / self.kernel.noise)
