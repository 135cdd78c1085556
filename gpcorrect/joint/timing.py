"""When to be where: corners of a path driven from rest to rest within the joints' speed limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["TimedPath", "timed"]

RAMP_SECONDS = 0.2  # to speed up and to slow down at each corner


@dataclass(frozen=True, eq=False)
class TimedPath:
    """Desired joints at a steady rate.

    Parameters
    ----------
    time : (n,) array
        s from 0.
    q : (n, dof) array
        rad or m.
    """

    time: FloatArray
    q: FloatArray

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1] - self.time[0])


def timed(corners: FloatArray, speed: FloatArray, rate_hz: float, ramp: float = RAMP_SECONDS) -> TimedPath:
    """Drive straight from corner to corner, the joint that needs longest at its speed limit, the others in step.

    Parameters
    ----------
    corners : (m, dof) array
        rad or m.
    speed : (dof,) array
        Highest speed of each joint, rad/s or m/s.
    rate_hz : float
        Samples a second.
    ramp : float
        Seconds of constant acceleration at both ends of each stretch.

    Raises
    ------
    DataError
        A speed or the rate is not above 0, or there is no way to drive.
    """
    speed = np.asarray(speed, dtype=np.float64)
    if speed.shape != corners.shape[1:] or not ((speed > 0).all() and rate_hz > 0):
        raise DataError(f"speed limits must be {corners.shape[1]} numbers above 0, got {speed.tolist()}.")
    cruise = np.max(np.abs(np.diff(corners, axis=0)) / speed, axis=1)
    if not cruise.sum() > 0:
        raise DataError("the path has no length.", hint="Give at least two different corners.")
    starts = np.concatenate([[0.0], np.cumsum(np.where(cruise > 0, cruise + ramp, 0.0))])
    time = np.arange(int(np.ceil(starts[-1] * rate_hz)) + 1) / rate_hz
    piece = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(cruise) - 1)
    share = _progress(time - starts[piece], cruise[piece], ramp)
    return TimedPath(time, corners[piece] + share[:, None] * (corners[piece + 1] - corners[piece]))


def _progress(t: FloatArray, cruise: FloatArray, ramp: float) -> FloatArray:
    """Share of a stretch done at t: speed rises, stays at or below 1 / cruise, and falls again within cruise + ramp."""
    total = cruise + ramp
    rise = np.minimum(ramp, total / 2)  # a stretch shorter than the ramp never cruises
    t = np.clip(t, 0.0, total)
    left = np.minimum(total - t, rise)
    risen = 0.5 * np.minimum(t, rise) ** 2 / rise
    cruised = np.clip(t, rise, total - rise) - rise
    fallen = 0.5 * (rise**2 - left**2) / rise
    share: FloatArray = (risen + cruised + fallen) / (total - rise)
    return share
