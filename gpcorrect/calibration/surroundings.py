"""How far from all that training held an input lies: what neither ranges nor a posterior variance see.

A motion of another kind may keep every feature inside its range and still combine them as no training motion did: of
random motion, a model of pick-and-place said that 97 % lay inside its ranges, where 37 to 52 % of its 95 % intervals
held at the wrist. What is usual is how far samples of left-out trajectories lie from the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from gpcorrect.calibration.dataset import folds_of
from gpcorrect.calibration.learners.polynomial import Scaler
from gpcorrect.errors import DataError
from gpcorrect.gpr import novelty_limit
from gpcorrect.types import BoolArray, FloatArray, IntArray

POINTS = 500
"""Training samples that are kept, evenly spread over the recording. With 2000 of them 98.9 instead of 87 % of a wiggled
wrist lay outside what pick-and-place had shown, at four times the work; chosen by hand."""
ROWS = 4096  # queries whose distances are taken at once: a million rows at once would take gigabytes


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Training inputs, and how far from the nearest of them an input may lie.

    Parameters
    ----------
    scaler : Scaler, of the inputs
    points : (k, d) array, some training inputs, scaled
    farthest : float, scaled distance to the nearest of them above which an input is outside
    """

    scaler: Scaler
    points: FloatArray
    farthest: float
    squares: FloatArray = field(init=False, repr=False)  # of the points' lengths: a stream asks at 1 kHz

    def __post_init__(self) -> None:
        inputs = self.points.shape[1:]
        if self.points.ndim != 2 or not len(self.points) or not inputs == self.scaler.centre.shape:
            raise DataError(f"points {self.points.shape} do not surround {len(self.scaler.centre)} inputs.")
        object.__setattr__(self, "squares", (self.points**2).sum(axis=1))

    @classmethod
    def of(cls, X: FloatArray, trajectory: IntArray) -> Self:
        """Return the surroundings of training inputs.

        Parameters
        ----------
        X : (n, d) array, training inputs
        trajectory : (n,) int array, motion of each; folds of them are left out in turn to see what is usual
        """
        scaler, folds = Scaler.of(X), folds_of(trajectory)
        scaled, some = scaler.apply(X), _spread_over(len(X))
        squares = (scaled**2).sum(axis=1)
        distance = np.full(len(X), np.nan)
        for fold in np.unique(folds):
            others = some[folds[some] != fold]
            if len(others):
                distance[folds == fold] = _to_nearest(scaled[folds == fold], scaled[others], squares[others])
        farthest = novelty_limit(distance) if np.isfinite(distance).any() else np.inf
        return cls(scaler, scaled[some], farthest)

    def hold(self, X: FloatArray) -> BoolArray:
        """Return which inputs `(n, d)` lie near training inputs.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        near: BoolArray = _to_nearest(self.scaler.apply(X), self.points, self.squares) <= self.farthest
        return near

    def joined(self, X: FloatArray) -> Self:
        """Return the surroundings with more training inputs among the points.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        added = self.scaler.apply(X[_spread_over(len(X))])
        return type(self)(self.scaler, np.vstack([self.points, added]), self.farthest)


def _spread_over(n: int) -> IntArray:
    """Return numbers of samples of n, evenly spread, no more than are kept."""
    return np.unique(np.linspace(0, n - 1, min(n, POINTS)).astype(np.int64))


def _to_nearest(X: FloatArray, points: FloatArray, squares: FloatArray) -> FloatArray:
    """Return the distances `(n,)` from inputs `(n, d)` to the nearest of points `(k, d)` of known squared lengths."""
    nearest = np.empty(len(X))
    for start in range(0, len(X), ROWS):
        part = X[start : start + ROWS]
        nearest[start : start + ROWS] = (part**2).sum(axis=1) + (squares - 2.0 * part @ points.T).min(axis=1)
    return np.sqrt(np.maximum(nearest, 0.0))
