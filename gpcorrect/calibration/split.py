"""Which samples are held out together: whole trajectories, whole sessions, or blocks of a single motion."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import BoolArray, CalibrationLog, IntArray


class HoldOut(StrEnum):
    """What is held out whole."""

    AUTO = "auto"
    TRAJECTORY = "trajectory"
    SESSION = "session"
    BLOCK = "block"


def _hold_out_units(log: CalibrationLog, by: HoldOut = HoldOut.AUTO) -> IntArray:
    """Return the unit `(n,)`, 0, 1... in recorded order, that each sample is held out with.

    AUTO takes trajectories, and blocks of time where there is one trajectory or the poses are static.
    """
    if by is HoldOut.AUTO:
        by = HoldOut.BLOCK if log.static or len(log.trajectory_ids) < 2 else HoldOut.TRAJECTORY
    if by is HoldOut.BLOCK:
        return np.arange(len(log)) * 5 * LIMITS.folds // max(len(log), 1)
    return in_order(log.session if by is HoldOut.SESSION else log.trajectory)


def held_out(
    log: CalibrationLog, holdout: float, by: HoldOut = HoldOut.AUTO, *, rng: np.random.Generator | None = None
) -> BoolArray:
    """Return which samples `(n,)` to measure on: the last fraction of whole units, or a random one.

    Parameters
    ----------
    log : CalibrationLog, n samples
    holdout : float, fraction of the units to measure on; 0 for none
    by : HoldOut, what the units are
    rng : numpy.random.Generator, optional, draws the units; the last ones are taken without it
    """
    if not 0 <= holdout < 1:
        raise DataError(f"the held-out fraction must be at least 0 and below 1, got {holdout}.")
    if holdout == 0:
        return np.zeros(len(log), dtype=bool)
    units = _hold_out_units(log, by)
    names = np.unique(units)
    if len(names) < 2:
        raise LogError(
            f"the log holds one {by if by is not HoldOut.AUTO else 'sample'}: nothing can be held out to measure on.",
            hint="Number the motions in the `trajectory` column, give more logs, or measure nothing: --holdout 0",
            path=log.name,
        )
    if rng is not None:
        names = rng.permutation(names)
    count = min(len(names) - 1, max(1, round(holdout * len(names))))
    return np.isin(units, names[-count:])


def folds_of(trajectory: IntArray) -> IntArray:
    """Fold `(n,)` of each sample: neighbouring whole trajectories, or blocks of time when there are fewer than two.

    Neighbours are left out together, for an arm changes slowly: a trajectory between two that were learned from is
    predicted better than any to come. (Taken in turn they gave intervals on simulated debridement that covered 79 to
    85 % of the worst axis of later trajectories, blocks 87 to 97 %.)

    Parameters
    ----------
    trajectory : (n,) int array, in recorded order
    """
    order = in_order(trajectory)
    count = int(order.max(initial=0)) + 1
    if count < 2:
        return np.arange(len(trajectory)) * LIMITS.folds // max(len(trajectory), 1)
    return order * min(LIMITS.folds, count) // count


def in_order(labels: IntArray) -> IntArray:
    """Return labels `(n,)` as numbers 0, 1... in the order in which they first come."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[index]
