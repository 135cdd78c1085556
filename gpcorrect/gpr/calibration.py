"""Intervals that hold on trajectories never seen: standard deviations scaled by what left-out trajectories showed.

Split-conformal calibration (Lei et al. 2018) of the normalised error |error| / std, with whole trajectories left out, because samples of one
trajectory err together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from gpcorrect.types import FloatArray, IntArray, frozen_array

__all__ = ["IntervalCalibration"]

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class IntervalCalibration:
    """How many standard deviations the half width of a 95 % interval is, for every output.

    Parameters
    ----------
    factor : (m,) array
        1.96 where errors are normal and the standard deviations right.
    """

    factor: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", frozen_array(self.factor))

    @classmethod
    def fit(cls, errors: FloatArray, std: FloatArray, groups: IntArray) -> Self:
        """Learn the factors from errors `(n, m)` at left-out samples with predicted standard deviations `(n, m)`.

        Every group (trajectory) counts alike, and the level is raised as if one more group had been missed:
        `0.95 (1 + 1 / groups)`, at most 1.
        """
        _, index, counts = np.unique(groups, return_inverse=True, return_counts=True)
        level = min(1.0, LEVEL * (1 + 1 / len(counts)))
        weights = 1.0 / counts[index]
        scores = np.abs(errors) / std
        return cls(np.array([_weighted_quantile(column, weights, level) for column in scores.T]))

    def interval95(self, std: FloatArray) -> FloatArray:
        """Half widths `(..., m)` of the intervals, from standard deviations `(..., m)`."""
        half: FloatArray = std * self.factor
        return half

    def to_dict(self) -> dict[str, Any]:
        """Return the factors as a list."""
        return {"factor": self.factor.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild a calibration from :meth:`to_dict`."""
        return cls(np.array(data["factor"]))


def _weighted_quantile(values: FloatArray, weights: FloatArray, level: float) -> float:
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][min(int(np.searchsorted(share, level)), len(values) - 1)])
