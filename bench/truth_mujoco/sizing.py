"""How large a hidden cause is: its own trace over the noise, measured by running the machine with and without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from truth.history import Readings

from truth_mujoco.causes import cause_named
from truth_mujoco.causes.cause import scaled
from truth_mujoco.machine import Hidden
from truth_mujoco.spec import Signals

__all__ = ["Meter", "grown"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLOSE = 0.1  # relative error of the ratio at which the search ends; the noise's level takes up the rest
TRIES = 8
STRIDE = 2.0  # of a step, in the logarithm of the factor
PHYSICAL: dict[str, dict[str, tuple[float, float]]] = {
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
}


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
            miss = after - (_rigidly(before, after) if self.fitted else before)
            found.append(float(np.sqrt(np.mean(miss**2))) / self.tracker)
        if self.signals != "tracker" and not cause.tracker_only:
            each = np.sqrt(np.mean((with_it.outside - without.outside)[rows] ** 2, axis=0)) / self.joints
            if cause.feedforward:
                moved = (with_it.reported - without.reported)[rows]
                each = np.maximum(each, np.sqrt(np.mean(moved**2, axis=0)) / self.joints)
            found.append(float(each[j] if cause.where == "joint" else each.max()))
        return max(found)


def _rigidly(points: Array, onto: Array) -> Array:
    """Points `(n, 3)` after the best rigid motion onto others (Kabsch 1976)."""
    a, b = points.mean(axis=0), onto.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - a).T @ (onto - b))
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    moved: Array = (points - a) @ turn + b
    return moved


def _clamped(hidden: Hidden) -> Hidden:
    params = dict(hidden.params)
    for name, (low, high) in PHYSICAL.get(hidden.name, {}).items():
        params[name] = float(np.clip(params[name], low, high))
    return replace(hidden, params=params)


def grown(hidden: Hidden, target: float, measure: Callable[[Hidden], float]) -> tuple[Hidden, float]:
    """Return the cause scaled until its measured ratio is near the target, as physics lets it; and its ratio.

    Secant steps on logarithms of factor and ratio, halving where a step leaves the bracket.
    """
    cause = cause_named(hidden.name)
    x, low, high = float(np.log(target)), -np.inf, np.inf
    best, best_miss, known = (hidden, 0.0), np.inf, (np.nan, np.nan)
    for _ in range(TRIES):
        trial = _clamped(replace(hidden, params=scaled(cause, hidden.params, float(np.exp(x)))))
        ratio = max(measure(trial), 1e-5)
        miss = float(np.log(ratio / target))
        if abs(miss) < best_miss:
            best, best_miss = (trial, ratio), abs(miss)
        if abs(miss) < CLOSE:
            break
        low, high = (max(low, x), high) if miss < 0 else (low, min(high, x))
        slope = (miss - known[1]) / (x - known[0]) if x != known[0] else np.nan
        known = (x, miss)
        x += float(np.clip(-miss / (slope if np.isfinite(slope) and 0.1 < slope < 1e3 else 1.0), -STRIDE, STRIDE))
        if not low < x < high:
            x = 0.5 * (low + high)
    return best
