"""How far along a path to be at each moment: progress from 0 to 1, from rest to rest."""

from __future__ import annotations

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["minimum_jerk", "trapezoid"]


def minimum_jerk(duration: float, rate_hz: float) -> FloatArray:
    """Progress `(n,)` of the smoothest motion of that duration: 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).

    Its peak speed is 1.875 times its mean.
    """
    n = max(2, round(duration * rate_hz) + 1)
    s = np.linspace(0.0, 1.0, n)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def trapezoid(distance: float, speed: float, acceleration: float, rate_hz: float) -> FloatArray:
    """Progress `(n,)` over `distance` at a cruising speed, with constant acceleration at both ends.

    A distance too short to reach the speed gives a triangle. The duration is rounded up to whole samples.

    Parameters
    ----------
    distance : float
        m or rad, >= 0.
    speed, acceleration : float
        In units of the distance per s and s^2, > 0.
    rate_hz : float
        Samples a second.

    Raises
    ------
    DataError
        Speed or acceleration is not above 0, or the distance is negative.
    """
    if not (speed > 0 and acceleration > 0 and distance >= 0):
        raise DataError(
            f"a trapezoid needs distance >= 0, speed > 0 and acceleration > 0, got {distance}, {speed} and "
            f"{acceleration}."
        )
    if distance == 0:
        return np.array([0.0, 1.0])
    top = min(speed, np.sqrt(distance * acceleration))
    ramp = top / acceleration
    duration = distance / top + ramp
    n = max(2, int(np.ceil(duration * rate_hz - 1e-9)) + 1)
    t = np.linspace(0.0, duration, n)
    rising = 0.5 * acceleration * np.minimum(t, ramp) ** 2
    cruising = top * (np.clip(t, ramp, duration - ramp) - ramp)
    left = np.minimum(duration - t, ramp)
    falling = 0.5 * acceleration * (ramp**2 - left**2)
    progress: FloatArray = np.clip((rising + cruising + falling) / distance, 0.0, 1.0)
    progress[0], progress[-1] = 0.0, 1.0
    return progress
