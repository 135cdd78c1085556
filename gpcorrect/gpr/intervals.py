"""Intervals that hold on trajectories never seen: standard deviations scaled by what left-out trajectories showed.

Conformal calibration of the normalised error `|error| / std` (Lei et al. 2018) with trajectories as the units that
are exchangeable, for samples of one trajectory err together: every trajectory counts alike, and the quantile is
raised until left-out trajectories are covered as promised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, IntArray, frozen_array

LEVEL = 0.95  # what an interval promises
FOLDS = 10  # of trajectories, that the level is checked on: the usual number, each trajectory left out once
INSIDE = 0.995  # of the left-out training samples: chosen by hand, so that the odd one of them is outside
STEPS = 16  # halvings of the level: finer than one sample in 50 000


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
        if self.factor.ndim != 1 or not ((self.factor >= 0) & np.isfinite(self.factor)).all():
            raise DataError(f"intervals of {self.factor} standard deviations cannot be.")

    @classmethod
    def fit(cls, errors: FloatArray, std: FloatArray, groups: IntArray) -> Self:
        """Learn the factors from errors at samples that the model did not learn from.

        Parameters
        ----------
        errors, std : (n, m) arrays
            Errors and the standard deviations predicted for them.
        groups : (n,) array
            Trajectory of each sample.

        Raises
        ------
        DataError
            Shapes do not match, there are no samples, or a standard deviation is not positive.
        """
        errors, std = np.asarray(errors, dtype=np.float64), np.asarray(std, dtype=np.float64)
        if errors.shape != std.shape or errors.ndim != 2 or len(errors) != len(groups) or len(errors) == 0:
            raise DataError(
                f"errors and std must be (n, m), groups (n,): got {errors.shape}, {std.shape}, {np.shape(groups)}."
            )
        if not (std > 0).all():
            raise DataError("a standard deviation is not positive.", hint="Predict with noise included.")
        labels: IntArray = np.unique(groups, return_inverse=True)[1]
        return cls(np.array([_factor(scores, labels) for scores in (np.abs(errors) / std).T]))

    def widened(self, by: float) -> Self:
        """Return the calibration with all intervals wider by a factor.

        Parameters
        ----------
        by : float
            1 leaves them as they are.
        """
        return type(self)(by * self.factor)

    def interval95(self, std: FloatArray) -> FloatArray:
        """Half widths `(..., m)` of the intervals, from standard deviations `(..., m)`.

        Parameters
        ----------
        std : (..., m) array
            Standard deviations.
        """
        return std * self.factor


def novelty_limit(novelty: FloatArray) -> float:
    """Novelty below which nearly all left-out training samples lie: a query above it is outside their region.

    Parameters
    ----------
    novelty : (n,) array
        Novelties of left-out training samples.
    """
    return float(np.quantile(novelty, INSIDE))


def _factor(scores: FloatArray, labels: IntArray) -> float:
    """Quantile of the scores `(n,)` at the smallest level that covers left-out groups to 95 %."""
    counts = np.bincount(labels)
    order = np.argsort(scores)
    scores, labels = scores[order], labels[order]
    weights = 1.0 / counts[labels]
    folds = labels % min(FOLDS, len(counts))
    low, high = LEVEL, 1.0
    for _ in range(STEPS if len(counts) > 1 else 0):
        middle = 0.5 * (low + high)
        covered = _covered(scores, weights, folds, middle)
        low, high = (low, middle) if covered >= LEVEL else (middle, high)
    return _quantile(scores, weights, low)


def _covered(scores: FloatArray, weights: FloatArray, folds: IntArray, level: float) -> float:
    """Weighted share of each fold below the quantile of the others, over all folds."""
    inside = 0.0
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        limit = _quantile(scores[~out], weights[~out], level)
        inside += float(weights[out][scores[out] <= limit].sum())
    return inside / float(weights.sum())


def _quantile(scores: FloatArray, weights: FloatArray, level: float) -> float:
    """Smallest score that has at least `level` of the weight at or below it; scores come sorted."""
    share = np.cumsum(weights) / weights.sum()
    return float(scores[min(int(np.searchsorted(share, level)), len(scores) - 1)])
