"""How large a learned correction may be, and how far from the training data a query may lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Bounds"]

HEADROOM = 1.5  # a query between training poses may need a little more than any training pose did


@dataclass(frozen=True)
class Bounds:
    """What limits a correction: a safety net under the regression, not part of it.

    Parameters
    ----------
    position : float
        Longest believed position residual, m.
    rotation : float
        Largest believed rotation residual, rad.
    novelty : float
        Share of prior variance left above which a query lies outside the training region.
    """

    position: float
    rotation: float
    novelty: float

    @classmethod
    def of(cls, residual: FloatArray, novelty: float) -> Self:
        """Bounds that every training residual `(n, 6)` keeps with headroom."""
        position = np.linalg.norm(residual[:, :3], axis=1)
        rotation = np.linalg.norm(np.nan_to_num(residual[:, 3:]), axis=1)
        return cls(HEADROOM * float(position.max()), HEADROOM * float(rotation.max()), novelty)

    def limit_rows(self, residual: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return residuals `(n, 6)` or `(n, 3)`, shortened where they are too large, and a mask of those that were."""
        bounds = np.array([self.position, self.rotation][: residual.shape[1] // 3])
        size = np.sqrt((residual.reshape(len(residual), -1, 3) ** 2).sum(axis=2))
        scale = np.minimum(1.0, bounds / np.maximum(size, 1e-300))
        return residual * np.repeat(scale, 3, axis=1), (scale < 1.0).any(axis=1)

    def in_domain(self, novelty: float) -> bool:
        """Whether one query lies inside the training region."""
        return novelty <= self.novelty

    def in_domain_rows(self, novelty: FloatArray) -> BoolArray:
        """Return the mask `(n,)` of queries inside the training region."""
        inside: BoolArray = novelty <= self.novelty
        return inside

    def to_dict(self) -> dict[str, Any]:
        """Return the bounds as plain numbers."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild bounds from :meth:`to_dict`."""
        return cls(**data)
