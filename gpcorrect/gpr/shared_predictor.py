"""Mean and standard deviation of outputs that share a kernel, from factors computed once.

With correlations k to the basis points the mean of output o is `k^T alpha_o` and its latent variance `s_o (1 - sum_j
c_oj w_j^2)`, `w = P k`: the shared kernel lets one product `P k` serve every output, whatever its noise
(docs/design/0002).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["SharedPredictor"]

BLOCK = 2048  # rows predicted at once: memory stays flat however many are asked


@dataclass(frozen=True, eq=False)
class SharedPredictor:
    """Everything a prediction needs, as read-only arrays: it changes nothing, so threads may share it.

    Parameters
    ----------
    component_weights : (c,) array
        Weights of the kernel's components.
    length_scales : (c, d) array
        Length scales of the kernel's components, in the inputs' units.
    basis : (p, d) array
        Points that predictions rest on: the inducing points, or the training inputs.
    alpha : (m, p) array
        Weights of the mean, in the outputs' units.
    offset : (m,) array
        Mean far from all data.
    projection : (r, q) array
        P above, over the first q <= p basis points: the variance may rest on fewer points than the mean. Rounded to
        single precision, which moves a standard deviation by some 1e-6 of itself: it is most of what a query reads,
        and half the bytes stay in the processor's cache.
    explained : (m, r) array
        c above: the share of prior variance that the data take away along each direction.
    signal, noise : (m,) arrays
        Prior variance and noise variance, in squared units of the outputs.
    """

    component_weights: FloatArray
    length_scales: FloatArray
    basis: FloatArray
    alpha: FloatArray
    offset: FloatArray
    projection: FloatArray
    explained: FloatArray
    signal: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        # C order always: another layout would round otherwise, and a reloaded model must answer to the last bit.
        for name in self._names():
            object.__setattr__(self, name, frozen_array(np.ascontiguousarray(getattr(self, name))))
        object.__setattr__(self, "projection", frozen_array(self.projection.astype(np.float32).astype(np.float64)))

    @classmethod
    def _names(cls) -> tuple[str, ...]:
        return tuple(f.name for f in fields(cls))

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Predict inputs `(n, d)`: means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)`."""
        n, m = len(X), len(self.offset)
        mean, std, novelty = np.empty((n, m)), np.empty((n, m)), np.empty(n)
        kernel = AdditiveRBF(self.component_weights, self.length_scales)
        for start in range(0, n, BLOCK):
            rows = slice(start, start + BLOCK)
            K = kernel(X[rows], self.basis)
            W = K[:, : self.projection.shape[1]] @ self.projection.T
            left = np.maximum(1.0 - (W * W) @ self.explained.T, 0.0)
            mean[rows] = K @ self.alpha.T + self.offset
            std[rows] = np.sqrt(left * self.signal + self.noise)
            novelty[rows] = left.min(axis=1)
        return mean, std, novelty

    def to_arrays(self) -> dict[str, FloatArray]:
        """Return the arrays by name, for a model file."""
        return {name: getattr(self, name) for name in self._names()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a predictor from :meth:`to_arrays`.

        Raises
        ------
        KeyError
            An array is missing.
        """
        return cls(**{name: np.asarray(arrays[name]) for name in cls._names()})
