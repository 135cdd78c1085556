"""The reference as a smooth curve: its values and derivatives at any time, inside what was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from gpcorrect.logs.streams import default_max_gap
from gpcorrect.logs.sync.motion import Motion
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["ReferenceCurve", "Sampled"]

MIN_KNOTS = 5
REACH = 2  # Akima's slope at a knot looks at two intervals on either side
STILL = 1e-9  # a column that spreads less than this share of the widest one carries nothing but rounding


@dataclass(frozen=True, eq=False)
class Sampled:
    """Reference columns `(n, m)` and their time derivatives at n times; rows count where `valid` (n,)."""

    values: FloatArray
    derivatives: FloatArray
    valid: BoolArray


class ReferenceCurve:
    """Akima splines through each piece of the reference: local, so a step disturbs its neighbourhood only.

    Columns are centred and scaled to unit spread, for well-conditioned least squares; columns that do not
    move are left out.

    Parameters
    ----------
    pieces : sequence of Motion
        The reference, a piece a trajectory.
    """

    def __init__(self, pieces: Sequence[Motion]) -> None:
        stacked = np.concatenate([p.regressors for p in pieces])
        centre, spread = stacked.mean(axis=0), stacked.std(axis=0)
        moving = spread > STILL * max(float(spread.max()), np.finfo(float).tiny)
        self.columns = int(moving.sum())
        self._knots = [p.time for p in pieces]
        self._sound = [_sound_intervals(p.time) for p in pieces]
        unit = np.where(moving, spread, 1.0)
        self._splines = [
            Akima1DInterpolator(p.time, ((p.regressors - centre) / unit)[:, moving]) if len(p) >= MIN_KNOTS else None
            for p in pieces
        ]

    def at(self, times: Sequence[FloatArray]) -> Sampled:
        """Sample every piece at its own times, stacked in order."""
        parts = [self._piece(i, t) for i, t in enumerate(times)]
        values, derivatives, valid = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Sampled(values, derivatives, valid)

    def _piece(self, i: int, t: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        blank = np.zeros((len(t), self.columns))
        spline = self._splines[i]
        if spline is None or not len(t):
            return blank, blank, np.zeros(len(t), dtype=np.bool_)
        knots = self._knots[i]
        interval = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        valid = (t >= knots[0]) & (t <= knots[-1]) & self._sound[i][interval]
        inside = np.clip(t, knots[0], knots[-1])
        return spline(inside), spline(inside, nu=1), valid


def _sound_intervals(time: FloatArray) -> BoolArray:
    """Mask of intervals between knots that are no gap and whose slopes see no gap."""
    gap = np.diff(time) > default_max_gap(time)
    near = np.convolve(gap, np.ones(2 * REACH + 1), mode="full")[REACH : REACH + len(gap)] > 0
    sound: BoolArray = ~near
    return sound
