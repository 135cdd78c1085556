"""The hot path: mean and standard deviation of all outputs for one input, from factors computed once.

With correlations k to the M basis points the mean is `k^T alpha` and the latent variance `s (1 - sum_j c_j w_j^2)`, `w = W k`: the
shared length scales let one product W k serve every output (docs/design/0002).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from gpcorrect.gpr.kernels import rbf
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["Predictor"]

BLOCK = 2048  # rows predicted at once: memory stays flat however many are asked


@dataclass(frozen=True, eq=False)
class Predictor:
    """Everything a prediction needs, as plain arrays: safe to share between threads, for it changes nothing.

    Parameters
    ----------
    scale : (d,) array
        What an input is multiplied by: one over the length scale.
    basis : (M, d) array
        Scaled basis points.
    half_squares : (M,) array
        Half their squared lengths.
    alpha : (m, M) array
        Weights of the mean, in output units.
    centre : (m,) array
        Mean of the outputs far from all data.
    factor : (r, M) array
        W above.
    shrink : (m, r) array
        c above.
    signal, noise : (m,) arrays
        Prior and noise variance, in squared output units.
    """

    scale: FloatArray
    basis: FloatArray
    half_squares: FloatArray
    alpha: FloatArray
    centre: FloatArray
    factor: FloatArray
    shrink: FloatArray
    signal: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, frozen_array(getattr(self, field.name)))

    def mean_std(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Mean `(m,)`, standard deviation `(m,)` and novelty for one input `(d,)`.

        Novelty is the share of the prior variance that is left, the mean over outputs: 0 amid data, 1 far from all.
        """
        z = x * self.scale
        k = np.exp(self.basis @ z - self.half_squares - 0.5 * (z @ z))
        w = self.factor @ k
        left = np.maximum(1.0 - self.shrink @ (w * w), 0.0)
        return self.centre + self.alpha @ k, np.sqrt(self.signal * left + self.noise), float(left.sum()) / len(left)

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)` for inputs `(n, d)`."""
        parts = [self._block(X[i : i + BLOCK]) for i in range(0, max(len(X), 1), BLOCK)]
        mean, std, novelty = (np.concatenate(part) for part in zip(*parts, strict=True))
        return mean, std, novelty

    def _block(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        K = rbf(X * self.scale, self.basis)
        w = K @ self.factor.T
        left = np.maximum(1.0 - (w * w) @ self.shrink.T, 0.0)
        return self.centre + K @ self.alpha.T, np.sqrt(self.signal * left + self.noise), left.mean(axis=1)

    def to_arrays(self) -> dict[str, FloatArray]:
        """Return the arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a predictor from :meth:`to_arrays`."""
        return cls(**arrays)
