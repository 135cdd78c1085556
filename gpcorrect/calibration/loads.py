"""Which efforts a motion takes: with another load, they are others at the same motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numba import njit

from gpcorrect.calibration.dataset import Layout, folds_of
from gpcorrect.calibration.learners.polynomial import PolynomialMap
from gpcorrect.errors import DataError
from gpcorrect.gpr import novelty_limit
from gpcorrect.types import BoolArray, FloatArray, IntArray

TINY = float(np.finfo(float).tiny)
OTHER = 0.5
"""Of how far off an effort may be, that is usual in a recording, above which its load is another: with four times the
mass 2.3 where it hangs, in other sessions and at other speeds up to 0.03, in runs of other loads, of which training
showed some, up to 0.3."""
FRICTION = 5.0  # times its usual speed over which a joint's dry friction turns over smoothly: a fifth; chosen by hand


@dataclass(frozen=True, eq=False)
class Loads:
    """Efforts as places and velocities explain them, and how far off they may be.

    A law of efforts cannot tell a heavier payload from more friction, and each effort may stay in its range. What gives
    the payload away is that the same motion takes other efforts.
    """

    efforts: IntArray  # (e,) inputs that are efforts
    place: IntArray  # (p,) inputs that say where the arm is
    velocities: IntArray  # (v,) inputs that are velocities
    usual: FloatArray  # (v,) their root mean squares
    law: PolynomialMap  # of places, velocities and their signs
    # (e,) how far off each effort may be, in its units: as nearly all samples of left-out motions are
    farthest: FloatArray
    tables: tuple[Any, ...] = field(init=False, repr=False)  # the law, as a stream reads it

    def __post_init__(self) -> None:
        scaler, inputs = self.law.scaler, self.place.size + 2 * self.velocities.size
        sizes = (inputs + 1) * (inputs + 2) // 2, self.efforts.size
        if (
            self.law.weights.shape != sizes
            or self.farthest.shape != sizes[1:]
            or self.usual.shape != self.velocities.shape
        ):
            raise DataError(f"a law of {self.law.weights.shape} does not say what {self.efforts.size} efforts are.")
        arrays = (self.usual, scaler.centre, scaler.spread, self.law.weights, np.maximum(self.farthest, TINY))
        # Copies: another layout or a read-only array would be compiled for anew.
        columns = [np.array(c, dtype=np.int64) for c in (self.efforts, self.place, self.velocities)]
        object.__setattr__(self, "tables", (*columns, *(np.array(a, dtype=np.float64) for a in arrays)))

    @classmethod
    def of(cls, X: FloatArray, trajectory: IntArray, layout: Layout) -> Self | None:
        """Return what training inputs show; None where there are no efforts, or no two motions to compare.

        Parameters
        ----------
        X : (n, d) array, training inputs
        trajectory : (n,) int array, motion of each; folds of them are left out in turn to see what is usual
        layout : Layout, which inputs are what
        """
        folds = folds_of(trajectory)
        if not (layout.efforts.size and layout.place.size and len(np.unique(folds)) > 1):
            return None
        usual = np.maximum(np.sqrt((X[:, layout.velocities] ** 2).mean(axis=0)), TINY)
        speed = X[:, layout.velocities] / usual
        motion = np.hstack([X[:, layout.place], speed, np.tanh(FRICTION * speed)])
        wanted, left = X[:, layout.efforts], np.empty((len(X), layout.efforts.size))
        for fold in np.unique(folds):
            out = folds == fold
            left[out] = wanted[out] - PolynomialMap.fit(motion[~out], wanted[~out], 2).mean(motion[out])
        farthest = np.array([novelty_limit(np.abs(column)) for column in left.T])
        return cls(
            layout.efforts, layout.place, layout.velocities, usual, PolynomialMap.fit(motion, wanted, 2), farthest
        )

    def off(self, X: FloatArray) -> FloatArray:
        """Return how far efforts are from what the motion takes, `(n, e)`, as shares of how far they may be.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        return _off(np.array(X, dtype=np.float64, order="C"), *self.tables)

    def hold(self, X: FloatArray) -> BoolArray:
        """Return which inputs `(n, d)` have the efforts of the training's loads.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        return np.asarray((np.abs(self.off(X)) <= 1.0).all(axis=1))

    def unlike(self, X: FloatArray) -> IntArray:
        """Return the inputs that are efforts of another load through most of a recording.

        Parameters
        ----------
        X : (n, d) array, inputs; rows with a NaN are missing
        """
        off = self.off(X[np.isfinite(X).all(axis=1)])
        return self.efforts[np.abs(np.median(off, axis=0)) > OTHER] if len(off) else self.efforts[:0]


@njit(cache=True, nogil=True)
def _off(
    X: FloatArray,
    efforts: IntArray,
    place: IntArray,
    velocities: IntArray,
    usual: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    farthest: FloatArray,
) -> FloatArray:
    """Return what the law of second degree leaves of efforts `(n, e)`, as shares of how far off they may be."""
    p, v = len(place), len(velocities)
    z, off = np.empty(p + 2 * v), np.empty((len(X), len(efforts)))
    for i in range(len(X)):
        for k in range(p):
            z[k] = X[i, place[k]]
        for k in range(v):
            z[p + k] = X[i, velocities[k]] / usual[k]
            z[p + v + k] = np.tanh(FRICTION * z[p + k])
        for k in range(len(z)):
            z[k] = (z[k] - centre[k]) / spread[k]
        for e in range(len(efforts)):
            mean, term = weights[0, e], 1 + len(z)
            for a in range(len(z)):
                mean += weights[1 + a, e] * z[a]
                for b in range(a, len(z)):
                    mean += weights[term, e] * z[a] * z[b]
                    term += 1
            off[i, e] = (X[i, efforts[e]] - mean) / farthest[e]
    return off
