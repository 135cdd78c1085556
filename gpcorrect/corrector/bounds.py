"""How large a learned correction may be, and how far from the training data a query may lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Bounds"]

HEADROOM = 1.5  # a query between training poses may need a little more than any training pose did
RANGE_QUANTILES = (0.5, 99.5)  # of each feature in training: a few wild velocities do not widen the region
MARGIN = 0.5  # of a feature's range that a query may lie beyond it


@dataclass(frozen=True)
class Bounds:
    """What limits a correction: a safety net under the regression, not part of it.

    The training region is where the posterior variance is small, and no feature far outside its training range: a
    feature that made no difference in training leaves the variance small however far it goes, but nothing is known
    out there.

    Parameters
    ----------
    position : float
        Longest believed position residual, m.
    rotation : float
        Largest believed rotation residual, rad.
    novelty : float
        Share of prior variance left above which a query lies outside the training region.
    low, high : tuple of d floats
        Range of each feature of pose and velocity; below and above a query lies outside.
    """

    position: float
    rotation: float
    novelty: float
    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def of(cls, residual: FloatArray, novelty: float, X: FloatArray, slack: FloatArray) -> Self:
        """Bounds that training residuals `(n, 6)` keep with headroom and training features `(n, d)` with a margin.

        The margin is half a feature's range, but `slack` `(d,)` at least.
        """
        position = np.linalg.norm(residual[:, :3], axis=1)
        rotation = np.linalg.norm(np.nan_to_num(residual[:, 3:]), axis=1)
        low, high = np.percentile(X, RANGE_QUANTILES, axis=0)
        margin = np.maximum(MARGIN * (high - low), slack)
        return cls(
            HEADROOM * float(position.max()),
            HEADROOM * float(rotation.max()),
            novelty,
            tuple((low - margin).tolist()),
            tuple((high + margin).tolist()),
        )

    def widened(self, other: Self) -> Self:
        """Return the bounds that hold both, with the novelty of these."""
        return type(self)(
            max(self.position, other.position),
            max(self.rotation, other.rotation),
            self.novelty,
            tuple(map(min, self.low, other.low)),
            tuple(map(max, self.high, other.high)),
        )

    def limit_rows(self, residual: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return residuals `(n, 6)` or `(n, 3)`, shortened where they are too large, and a mask of those that were."""
        bounds = np.array([self.position, self.rotation][: residual.shape[1] // 3])
        size = np.sqrt((residual.reshape(len(residual), -1, 3) ** 2).sum(axis=2))
        scale = np.minimum(1.0, bounds / np.maximum(size, 1e-300))
        return residual * np.repeat(scale, 3, axis=1), (scale < 1.0).any(axis=1)

    def in_domain_rows(self, novelty: FloatArray, X: FloatArray) -> BoolArray:
        """Return the mask `(n,)` of queries inside the training region; features behind the d bounded ones are free."""
        bounded = X[:, : len(self.low)]
        near = ((bounded >= self.low) & (bounded <= self.high)).all(axis=1)
        inside: BoolArray = near & (novelty <= self.novelty)
        return inside

    def to_dict(self) -> dict[str, Any]:
        """Return the bounds as plain numbers."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild bounds from :meth:`to_dict`."""
        return cls(**{**data, "low": tuple(data["low"]), "high": tuple(data["high"])})
