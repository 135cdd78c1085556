"""Where answers can be trusted, and how large a correction may be: the same for every task and learner."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np
from numba import njit

from gpcorrect.calibration.dataset import evenly_spread, folds_of
from gpcorrect.calibration.learners.polynomial import Scaler
from gpcorrect.calibration.loads import Loads
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError
from gpcorrect.gpr import novelty_limit
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

WITHOUT_MARGIN = 1 / (1 + 2 * LIMITS.margin)  # of half a region, the part that is not margin
POINTS = 500
"""Training samples that are kept, evenly spread over the recording. With 2000 of them 98.9 instead of 87 % of a wiggled
wrist lay outside what pick-and-place had shown, at four times the work; chosen by hand."""
ROWS = 4096  # queries whose distances are taken at once: a million rows at once would take gigabytes


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Training inputs, and how far from the nearest of them an input may lie: what neither ranges nor a posterior see.

    A motion of another kind may keep every feature inside its range and still combine them as no training motion did:
    of random motion, a model of pick-and-place said that 97 % lay inside its ranges, where 37 to 52 % of its 95 %
    intervals held at the wrist. What is usual is how far samples of left-out trajectories lie from the others.

    Where the arm is is asked by itself too: among dozens of velocities and slacks, whose distances are usual anywhere,
    three joints beyond all of the training by a third of their ranges made no difference.
    """

    scaler: Scaler  # of the inputs
    points: FloatArray  # (k, d) some training inputs, scaled
    farthest: float  # scaled distance to the nearest of them above which an input is outside
    # (p,) inputs that are places, and the same distance in them alone; none in older files
    place: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    farthest_place: float = np.inf
    tables: tuple[Any, ...] = field(init=False, repr=False)  # the same as a query reads it: a stream asks at 1 kHz

    def __post_init__(self) -> None:
        inputs = self.points.shape[1:]
        if self.points.ndim != 2 or not len(self.points) or not inputs == self.scaler.centre.shape:
            raise DataError(f"points {self.points.shape} do not surround {len(self.scaler.centre)} inputs.")
        if not set(self.place.tolist()) <= set(range(*inputs)):
            raise DataError(f"places {self.place} are not all among {inputs[0]} inputs.")
        arrays = (self.scaler.centre, self.scaler.spread, self.points)
        limits = float(self.farthest) ** 2, float(self.farthest_place) ** 2
        # Copies: another layout or a read-only array would be compiled for anew.
        tables = (*(np.array(a, dtype=np.float64) for a in arrays), np.array(self.place, dtype=np.int64), *limits)
        object.__setattr__(self, "tables", tables)

    @classmethod
    def of(cls, X: FloatArray, trajectory: IntArray, place: IntArray | None = None) -> Self:
        """Return the surroundings of training inputs.

        Parameters
        ----------
        X : (n, d) array, training inputs
        trajectory : (n,) int array, motion of each; folds of them are left out in turn to see what is usual
        place : (p,) int array, optional, inputs that must lie near training inputs by themselves too
        """
        if place is not None and len(place):
            return replace(cls.of(X, trajectory), place=place, farthest_place=cls.of(X[:, place], trajectory).farthest)
        scaler, folds = Scaler.of(X), folds_of(trajectory)
        scaled, some = scaler.apply(X), evenly_spread(len(X), POINTS)
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
        if X.shape[1:] != self.points.shape[1:]:  # compiled code does not look
            raise DataError(f"points {self.points.shape} were asked whether they surround inputs {X.shape}.")
        return _hold(np.array(X, dtype=np.float64, order="C"), *self.tables)

    def joined(self, X: FloatArray) -> Self:
        """Return the surroundings of these training inputs too, with no more points than a training has.

        Of the old and the new points, one after the other that farthest from those taken so far is kept.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        points = np.vstack([self.points, self.scaler.apply(X[evenly_spread(len(X), POINTS)])])
        kept, nearest = [0], np.full(len(points), np.inf)
        while len(kept) < min(POINTS, len(points)):
            nearest = np.minimum(nearest, ((points - points[kept[-1]]) ** 2).sum(axis=1))
            kept.append(int(nearest.argmax()))
        return replace(self, points=points[np.sort(kept)])


@dataclass(frozen=True, eq=False)
class Domain:
    """The training region: every input inside its range, novelty below its limit, and training samples near.

    A feature that made no difference in training leaves the posterior variance small however far it goes, but nothing
    is known out there; hence the ranges beside the novelty.
    """

    # (d,) each: range of each bounded input; inputs behind the first d are free
    low: FloatArray
    high: FloatArray
    # fraction of prior variance left above which a query is outside; infinite for learners that know no novelty
    novelty: float
    # (m,) deviations at which intervals are as wide as those of no correction: how wrong an answer may be where nothing
    # is known
    spread: FloatArray
    # (f,) bounded inputs that an extrapolating law is not asked of outside: see :meth:`clip`
    fading: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    # (f,) how far from the middle of the region, in halves of it, each of them is left as it is: as far as training
    # went, in files that say so
    kept: FloatArray = field(default_factory=lambda: np.zeros(0))
    # training inputs near which a query must lie; None in older files
    near: Surroundings | None = None
    # which efforts a motion takes; None where efforts are no inputs, and in older files
    loads: Loads | None = None
    # middle and half, (f,) each, of the region of the inputs that fade: a stream asks at 1 kHz
    faded: tuple[FloatArray, FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.kept.size:  # older files
            object.__setattr__(self, "kept", np.full(len(self.fading), WITHOUT_MARGIN))
        for name in ("low", "high", "spread", "kept"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        if self.low.shape != self.high.shape or not (self.low <= self.high).all() or not (self.spread >= 0).all():
            raise DataError(
                f"no region reaches from {self.low} to {self.high}, or has targets that are spread {self.spread}."
            )
        if not set(self.fading.tolist()) <= set(range(len(self.low))):
            raise DataError(f"inputs {self.fading} are to fade, which are not all among {len(self.low)}.")
        if self.kept.shape != self.fading.shape or not ((self.kept > 0) & (self.kept < 1)).all():
            raise DataError(f"inputs {self.fading} cannot fade from {self.kept} of the way to the region's edge.")
        if self.near is not None and self.near.points.shape[1:] != self.low.shape:
            raise DataError(f"points {self.near.points.shape} do not surround {len(self.low)} bounded inputs.")
        object.__setattr__(self, "faded", self._middle_and_half(self.fading))

    @classmethod
    def of(
        cls, X: FloatArray, slack: FloatArray, novelty: float, targets: FloatArray, fading: IntArray | None = None
    ) -> Self:
        """Return the region of training inputs.

        Parameters
        ----------
        X : (n, d) array, training inputs; the margin around their range is half of it, but `slack` at least
        slack : (d,) array, how far outside its range an input may always be
        novelty : float
        targets : (n, m) array, what was to be predicted; the spread is their root mean square
        fading : (f,) int array, optional
        """
        low, high = np.percentile(X, LIMITS.range_quantiles, axis=0)
        margin = np.maximum(LIMITS.margin * (high - low), slack)
        region = cls(low - margin, high + margin, novelty, np.sqrt((targets**2).mean(axis=0)))
        if fading is None:
            return region
        middle, half = region._middle_and_half(fading)
        went = np.abs((X[:, fading] - middle) / half).max(axis=0)
        return replace(region, fading=fading, kept=np.clip(went, WITHOUT_MARGIN, LIMITS.fades_from))

    def _middle_and_half(self, inputs: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the middle `(k,)` and half `(k,)` of the region of k inputs."""
        low, high = self.low[inputs], self.high[inputs]
        return (low + high) / 2, np.maximum((high - low) / 2, np.finfo(float).tiny)

    def widened(self, other: Self) -> Self:
        """Return the region that holds both, with the novelty and spread of this one.

        Parameters
        ----------
        other : Domain, of the same inputs
        """
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return replace(self, low=low, high=high)

    def clip(self, X: FloatArray) -> FloatArray:
        """Return inputs `(..., D)` as a law that extrapolates reads them: inside the region.

        Positions, slacks and loads stay at the region's edge. Rates fade: from where training ended they go back to the
        middle, so that outside the region they change nothing. (Held at the edge, a velocity law of slow motion made
        joint 1 of a dVRK 2.3 times worse than no correction on a faster recording. Where they faded from the range's
        quantiles on, joints 1 and 2 had up to a sixth more error on their own recording, whose fastest
        hundredth of samples is half as fast again.)

        Parameters
        ----------
        X : (..., D) array
        """
        inputs = X.copy()
        inputs[..., : len(self.low)] = np.clip(X[..., : len(self.low)], self.low, self.high)
        if self.fading.size:
            middle, half = self.faded
            place, start = (inputs[..., self.fading] - middle) / half, self.kept
            fraction = np.clip((1 - np.abs(place)) / (1 - start), 0, 1)
            inputs[..., self.fading] = middle + fraction * half * np.clip(place, -start, start)
        return inputs

    def holds(self, X: FloatArray, novelty: FloatArray) -> BoolArray:
        """Return which inputs `(n, D)` with novelties `(n,)` lie inside.

        Parameters
        ----------
        X : (n, D) array, inputs
        novelty : (n,) array, fraction of the prior variance left at each
        """
        bounded = X[:, : len(self.low)]
        inside = ((bounded >= self.low) & (bounded <= self.high)).all(axis=1) & (novelty <= self.novelty)
        if inside.any():
            inside[inside] = self.surrounded(bounded[inside])
        return inside

    def surrounded(self, X: FloatArray) -> BoolArray:
        """Return which inputs `(n, D)` lie near training samples, under its loads; all, where these are not known.

        Parameters
        ----------
        X : (n, D) array, inputs
        """
        held = np.ones(len(X), dtype=bool) if self.near is None else self.near.hold(X[:, : len(self.low)])
        return held if self.loads is None else held & self.loads.hold(X)

    def widen(self, std: FloatArray, inside: BoolArray | bool) -> FloatArray:
        """Return standard deviations `(..., m)`, outside the region no smaller than :attr:`spread`.

        Parameters
        ----------
        std : (..., m) array, standard deviations, m or rad
        inside : (...) mask or bool, which of them lie inside the region
        """
        if inside is True:
            return std
        outside = ~np.asarray(inside)[..., None]
        return np.where(outside, np.maximum(std, self.spread), std)


@dataclass(frozen=True, eq=False)
class Bounds:
    """How large a correction may be: a limit that does not depend on the learner."""

    # how many components in turn are bounded together: (3, 3) for positions and rotations, 1 for each joint
    sizes: tuple[int, ...]
    largest: FloatArray  # (g,) largest believed length of each group, m or rad

    def __post_init__(self) -> None:
        object.__setattr__(self, "largest", frozen_array(self.largest))

    @classmethod
    def of(cls, targets: FloatArray, sizes: tuple[int, ...]) -> Self:
        """Return bounds that training targets `(n, m)` keep with headroom.

        Parameters
        ----------
        targets : (n, m) array, training corrections, m or rad
        sizes : tuple of int, how many components in turn are bounded together
        """
        return cls(sizes, LIMITS.headroom * _lengths(targets, sizes).max(axis=0))

    def widened(self, other: Self) -> Self:
        """Return the bounds that hold both.

        Parameters
        ----------
        other : Bounds, of the same groups
        """
        return type(self)(self.sizes, np.maximum(self.largest, other.largest))

    def limit(self, residual: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return residuals `(n, m)`, shortened where they are too long, and which rows `(n,)` were.

        Parameters
        ----------
        residual : (n, m) array, corrections, m or rad
        """
        scale = np.minimum(1.0, self.largest / np.maximum(_lengths(residual, self.sizes), 1e-300))
        cut: BoolArray = np.asarray((scale < 1.0).any(axis=1))
        return residual * np.repeat(scale, self.sizes, axis=1), cut


def _lengths(values: FloatArray, sizes: tuple[int, ...]) -> FloatArray:
    """Return the lengths `(n, g)` of groups of so many columns in turn."""
    return np.sqrt(np.add.reduceat(values**2, _starts(sizes), axis=1))


@lru_cache(maxsize=64)
def _starts(sizes: tuple[int, ...]) -> IntArray:
    """Return the first column `(g,)` of each group."""
    return frozen_array(np.concatenate([[0], np.cumsum(sizes)[:-1]]), np.int64)


@njit(cache=True, nogil=True)
def _hold(
    X: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
    points: FloatArray,
    place: IntArray,
    farthest: float,
    farthest_place: float,
) -> BoolArray:
    """Return which inputs `(n, d)` have a point `(k, d)` within one squared distance, and one within another in place.

    The first that is near enough ends the search: amid training samples after a few.
    """
    near, scaled = np.empty(len(X), dtype=np.bool_), np.empty(X.shape[1])
    for i in range(len(X)):
        for d in range(len(scaled)):
            scaled[d] = (X[i, d] - centre[d]) / spread[d]
        found, found_place = False, len(place) == 0
        for point in points:
            if not found_place:
                total = 0.0
                for d in place:
                    total += (scaled[d] - point[d]) ** 2
                found_place = total <= farthest_place
            if not found:
                total = 0.0
                for d in range(len(scaled)):
                    total += (scaled[d] - point[d]) ** 2
                found = total <= farthest
            if found and found_place:
                break
        near[i] = found and found_place
    return near


def _to_nearest(X: FloatArray, points: FloatArray, squares: FloatArray) -> FloatArray:
    """Return the distances `(n,)` from inputs `(n, d)` to the nearest of points `(k, d)` of known squared lengths."""
    nearest = np.empty(len(X))
    for start in range(0, len(X), ROWS):
        part = X[start : start + ROWS]
        nearest[start : start + ROWS] = (part**2).sum(axis=1) + (squares - 2.0 * part @ points.T).min(axis=1)
    return np.sqrt(np.maximum(nearest, 0.0))
