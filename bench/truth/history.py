"""What a run leaves behind: the motion at the ticks, before and after the effects on the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truth.loop import TICK_HZ, Recorded
from truth.reference import Reference

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class History:
    """A reference and the motion that followed it; `gravity` (3,) m/s^2."""

    reference: Reference
    motion: Recorded
    gravity: Array

    @property
    def step(self) -> float:
        """Seconds between ticks."""
        return 1.0 / TICK_HZ


@dataclass(frozen=True, eq=False)
class Readings:
    """What is true at the ticks, before the sensors' noise.

    Parameters
    ----------
    outside : (n, 3) array, true joint values
    reported : (n, 3) array, motor side
    effort : (n, 3) array, commanded torque
    tip : (n, 4, 4) array, true tool pose, base frame
    extra_noise : (n, 3) array, standard deviation of noise beyond the declared, rad or m; zero is none
    """

    outside: Array
    reported: Array
    effort: Array
    tip: Array
    extra_noise: Array
