"""What is known of a group of outputs before its posterior: units, kernel and variances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.learning import Hyperparameters
from gpcorrect.types import FloatArray

__all__ = ["Learned", "Scaling"]

FLAT = 1e-12  # a column whose spread is this small beside its values is constant but for rounding


@dataclass(frozen=True, eq=False)
class Scaling:
    """Spread of inputs and centre and spread of outputs; a column that does not vary keeps its unit."""

    x_spread: FloatArray
    y_centre: FloatArray
    y_spread: FloatArray

    @classmethod
    def of(cls, X: FloatArray, Y: FloatArray) -> Self:
        """Scaling that gives the columns of `X` (n, d) and `Y` (n, m) unit spread."""
        return cls(_spread(X), Y.mean(axis=0), _spread(Y))

    def outputs(self, Y: FloatArray) -> FloatArray:
        """Return outputs `(n, m)` centred and of unit spread."""
        scaled: FloatArray = (Y - self.y_centre) / self.y_spread
        return scaled


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned of one group of outputs before the posterior: their kernel, variances and units.

    Parameters
    ----------
    columns : slice
        The group's outputs.
    scaling : Scaling
        Units in which the hyperparameters are.
    hyperparameters : Hyperparameters
    """

    columns: slice
    scaling: Scaling
    hyperparameters: Hyperparameters

    @property
    def kernel(self) -> AdditiveRBF:
        """Correlation over inputs in the inputs' own units."""
        kernel = self.hyperparameters.kernel
        return AdditiveRBF(kernel.weights, kernel.length_scales * self.scaling.x_spread)

    @property
    def noise_ratio(self) -> FloatArray:
        """Noise over signal variance `(m,)`."""
        ratio: FloatArray = self.hyperparameters.noise / self.hyperparameters.signal
        return ratio

    @property
    def signal(self) -> FloatArray:
        """Prior variance `(m,)` in squared units of the outputs."""
        variance: FloatArray = self.hyperparameters.signal * self.scaling.y_spread**2
        return variance

    @property
    def noise(self) -> FloatArray:
        """Noise variance `(m,)` in squared units of the outputs."""
        variance: FloatArray = self.hyperparameters.noise * self.scaling.y_spread**2
        return variance


def _spread(values: FloatArray) -> FloatArray:
    spread = values.std(axis=0)
    return np.where(spread <= FLAT * np.abs(values).max(axis=0), 1.0, spread)
