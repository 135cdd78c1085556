"""Where answers can be trusted, and how large a correction may be: the same for every task and learner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.calibration.settings import LIMITS
from gpcorrect.types import BoolArray, FloatArray, frozen_array

__all__ = ["Bounds", "Domain"]


@dataclass(frozen=True, eq=False)
class Domain:
    """The training region: every input inside its range, and novelty below its limit.

    A feature that made no difference in training leaves the posterior variance small however far it goes, but nothing
    is known out there; hence the ranges beside the novelty.

    Parameters
    ----------
    low, high : (d,) arrays
        Range of each bounded input; inputs behind the first d are free.
    novelty : float
        Fraction of prior variance left above which a query is outside; infinite for learners that know no novelty.
    spread : (m,) array
        Root mean square of the training targets: how wrong an answer may be where nothing is known.
    """

    low: FloatArray
    high: FloatArray
    novelty: float
    spread: FloatArray

    def __post_init__(self) -> None:
        for name in ("low", "high", "spread"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    @classmethod
    def of(cls, X: FloatArray, slack: FloatArray, novelty: float, targets: FloatArray) -> Self:
        """Return the region of training inputs.

        Parameters
        ----------
        X : (n, d) array
            Training inputs; the margin around their range is half of it, but `slack` at least.
        slack : (d,) array
            How far outside its range an input may always be.
        novelty : float
            See above.
        targets : (n, m) array
            What was to be predicted.
        """
        low, high = np.percentile(X, LIMITS.range_quantiles, axis=0)
        margin = np.maximum(LIMITS.margin * (high - low), slack)
        return cls(low - margin, high + margin, novelty, np.sqrt((targets**2).mean(axis=0)))

    def widened(self, other: Self) -> Self:
        """Return the region that holds both, with the novelty and spread of this one.

        Parameters
        ----------
        other : Domain
            Of the same inputs.
        """
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return type(self)(low, high, self.novelty, self.spread)

    def clip(self, X: FloatArray) -> FloatArray:
        """Return inputs `(..., D)` clipped to their ranges, for laws that extrapolate.

        Parameters
        ----------
        X : (..., D) array
            Inputs.
        """
        bounded = X[..., : len(self.low)]
        return np.concatenate([np.clip(bounded, self.low, self.high), X[..., len(self.low) :]], axis=-1)

    def holds(self, X: FloatArray, novelty: FloatArray) -> BoolArray:
        """Return which inputs `(n, D)` with novelties `(n,)` lie inside.

        Parameters
        ----------
        X : (n, D) array
            Inputs.
        novelty : (n,) array
            Fraction of the prior variance left at each.
        """
        bounded = X[:, : len(self.low)]
        inside: BoolArray = ((bounded >= self.low) & (bounded <= self.high)).all(axis=1) & (novelty <= self.novelty)
        return inside

    def widen(self, std: FloatArray, inside: BoolArray | bool) -> FloatArray:
        """Return standard deviations `(..., m)`, outside the region no smaller than the spread of the targets.

        Parameters
        ----------
        std : (..., m) array
            Standard deviations, m or rad.
        inside : (...) mask or bool
            Which of them lie inside the region.
        """
        if inside is True:
            return std
        outside = ~np.asarray(inside)[..., None]
        wide: FloatArray = np.where(outside, np.maximum(std, self.spread), std)
        return wide


@dataclass(frozen=True, eq=False)
class Bounds:
    """How large a correction may be: a limit that does not depend on the learner.

    Parameters
    ----------
    sizes : tuple of int
        How many components in turn are bounded together: (3, 3) for positions and rotations, 1 for each joint.
    largest : (g,) array
        Largest believed length of each group, m or rad.
    """

    sizes: tuple[int, ...]
    largest: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "largest", frozen_array(self.largest))

    @classmethod
    def of(cls, targets: FloatArray, sizes: tuple[int, ...]) -> Self:
        """Return bounds that training targets `(n, m)` keep with headroom.

        Parameters
        ----------
        targets : (n, m) array
            Training corrections, m or rad.
        sizes : tuple of int
            How many components in turn are bounded together.
        """
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        lengths = np.sqrt(np.add.reduceat(targets**2, starts, axis=1))
        return cls(sizes, LIMITS.headroom * lengths.max(axis=0))

    def widened(self, other: Self) -> Self:
        """Return the bounds that hold both.

        Parameters
        ----------
        other : Bounds
            Of the same groups.
        """
        return type(self)(self.sizes, np.maximum(self.largest, other.largest))

    def limit(self, residual: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return residuals `(n, m)`, shortened where they are too long, and which rows `(n,)` were.

        Parameters
        ----------
        residual : (n, m) array
            Corrections, m or rad.
        """
        starts = np.concatenate([[0], np.cumsum(self.sizes)[:-1]])
        lengths = np.sqrt(np.add.reduceat(residual**2, starts, axis=1))
        scale = np.minimum(1.0, self.largest / np.maximum(lengths, 1e-300))
        cut: BoolArray = np.asarray((scale < 1.0).any(axis=1))
        return residual * np.repeat(scale, self.sizes, axis=1), cut
