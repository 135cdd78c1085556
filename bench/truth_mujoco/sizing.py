"""How large a hidden cause is: its own trace over the noise, measured by running the machine with and without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from truth.hidden import Growth, Hidden, rigidly
from truth.history import Readings

from truth_mujoco.causes import cause_named
from truth_mujoco.spec import Signals

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PHYSICAL = {
    "resonance": {"frequency": (5.0, 40.0)},
    "capstan_friction": {"wrap": (1e-4, 0.5)},
    "payload": {"mass": (2e-3, 1.0)},
    "delay": {"delay": (2e-4, 0.05)},
    "transmission_ratio": {"error": (-0.2, 0.2)},
    "shaft_bending": {"rigidity": (0.2, 200.0)},
    "rcm_shift": {"stiffness": (300.0, 1e7)},
    "feedforward_error": {"fraction": (-1.0, 1.0)},
    "gain_error": {"proportional": (-0.6, 1.5), "derivative": (-0.6, 1.5)},
    "swaying_base": {"angle": (1e-4, 0.3)},
    "link_mass_error": {"mass": (-0.1, 3.0)},
    "centre_of_mass_error": dict.fromkeys("xyz", (-0.4, 0.4)),
    "gravity_error": dict.fromkeys("xyz", (-8.0, 8.0)),
    "inertia_error": {"inertia": (0.0, 130.0)},  # twice the largest motor here
}
GROWTH = Growth(close=0.1, tries=8, stride=2.0, physical=PHYSICAL)


@dataclass(frozen=True, eq=False)
class Meter:
    """How ratios are measured: sensors, RMS of the noise of joints `(k,)` and tracker, and who registers the tracker.

    `fitted` leaves the registration to the data, which then takes up what a rigid motion can.
    """

    signals: Signals
    joints: Array
    tracker: float
    fitted: bool

    def ratio(self, hidden: Hidden, with_it: Readings, without: Readings, rows: Ints) -> float:
        """RMS of the trace of a cause over RMS of the noise, in the sensors that show it best."""
        cause, j = cause_named(hidden.name), hidden.column
        if cause.channel == "noise":
            return float(np.sqrt(np.mean(with_it.extra_noise[rows, j] ** 2)) / self.joints[j])
        if cause.channel == "reported":
            trace = (with_it.reported - without.reported)[rows, j]
            return float(np.sqrt(np.mean(trace**2)) / self.joints[j])
        found = []
        if self.signals in ("tracker", "both"):
            before, after = without.tip[rows, :3, 3], with_it.tip[rows, :3, 3]
            miss = after - (rigidly(before, after) if self.fitted else before)
            found.append(float(np.sqrt(np.mean(miss**2))) / self.tracker)
        if self.signals != "tracker" and not cause.tracker_only:
            each = np.sqrt(np.mean((with_it.outside - without.outside)[rows] ** 2, axis=0)) / self.joints
            if cause.feedforward:
                moved = (with_it.reported - without.reported)[rows]
                each = np.maximum(each, np.sqrt(np.mean(moved**2, axis=0)) / self.joints)
            found.append(float(each[j] if cause.where == "joint" else each.max()))
        return max(found)
