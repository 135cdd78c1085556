"""How large a hidden cause is: its own trace over the noise, measured by simulating with and without it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truth.hidden import Growth, Hidden, rigidly
from truth.history import Readings
from truth.kinds import kind_named

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PHYSICAL = {
    "resonance": {"frequency": (5.0, 40.0)},
    "capstan_friction": {"wrap": (1e-4, 0.5)},
    "payload": {"mass": (2e-3, 1.0)},
    "joint_stop": {"stiffness": (0.05, 2e5)},
    "delay": {"delay": (2e-4, 0.05)},
    "transmission_ratio": {"error": (-0.2, 0.2)},
    "shaft_bending": {"rigidity": (0.05, 200.0)},
    "rcm_shift": {"stiffness": (300.0, 1e7)},
}
GROWTH = Growth(close=0.03, tries=9, stride=2.5, physical=PHYSICAL)


def ratio_of(
    hidden: Hidden, with_it: Readings, without: Readings, rows: Ints, noise: Array, tracker: float | None, fitted: bool
) -> float:
    """RMS of the trace of a cause over RMS of the noise.

    Parameters
    ----------
    hidden : Hidden, the cause
    with_it, without : Readings, of the two runs
    rows : int array, logged ticks
    noise : (3,) array, RMS of the noise on the joint sensors
    tracker : float or None, RMS of the noise on an axis of the tracker, when it is the only sensor
    fitted : bool
        Whether the tracker's registration is left to the data, which then takes up what a rigid motion can.
    """
    kind, j = kind_named(hidden.name), hidden.column
    if kind.channel == "noise":
        return float(np.sqrt(np.mean(with_it.extra_noise[rows, j] ** 2)) / noise[j])
    if tracker is not None:
        before, after = without.tip[rows, :3, 3], with_it.tip[rows, :3, 3]
        miss = after - (rigidly(before, after) if fitted else before)
        return float(np.sqrt(np.mean(miss**2))) / tracker
    trace = with_it.outside[rows] - without.outside[rows]
    if kind.channel == "reported":
        trace = (with_it.reported - with_it.outside - without.reported + without.outside)[rows]
    each = np.sqrt(np.mean(trace**2, axis=0)) / noise
    return float(each[j] if kind.where == "joint" else each.max())
