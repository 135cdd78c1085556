"""How large a hidden cause is: its own trace over the noise, measured by simulating with and without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truth.history import Readings
from truth.kinds import kind_named
from truth.kinds.kind import scaled
from truth.machine import Hidden

__all__ = ["clamped", "grown", "ratio_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLOSE = 0.03  # relative error of the ratio at which the search ends; the noise's level takes up the rest
TRIES = 9
STRIDE = 2.5  # of a step, in the logarithm of the factor
PHYSICAL: dict[str, dict[str, tuple[float, float]]] = {
    "resonance": {"frequency": (5.0, 40.0)},
    "capstan_friction": {"wrap": (1e-4, 0.5)},
    "payload": {"mass": (2e-3, 1.0)},
    "joint_stop": {"stiffness": (0.05, 2e5)},
    "delay": {"delay": (2e-4, 0.05)},
    "transmission_ratio": {"error": (-0.2, 0.2)},
    "shaft_bending": {"rigidity": (0.05, 200.0)},
    "rcm_shift": {"stiffness": (300.0, 1e7)},
}


def ratio_of(
    hidden: Hidden, with_it: Readings, without: Readings, rows: Ints, noise: Array, tracker: float | None, fitted: bool
) -> float:
    """RMS of the trace of a cause over RMS of the noise.

    Parameters
    ----------
    hidden : Hidden
        The cause.
    with_it, without : Readings
        Of the two runs.
    rows : int array
        Logged ticks.
    noise : (3,) array
        RMS of the noise on the joint sensors.
    tracker : float or None
        RMS of the noise on an axis of the tracker, when it is the only sensor.
    fitted : bool
        Whether the tracker's registration is left to the data, which then takes up what a rigid motion can.
    """
    kind, j = kind_named(hidden.name), hidden.column
    if kind.channel == "noise":
        return float(np.sqrt(np.mean(with_it.extra_noise[rows, j] ** 2)) / noise[j])
    if tracker is not None:
        before, after = without.tip[rows, :3, 3], with_it.tip[rows, :3, 3]
        miss = after - (_rigidly(before, after) if fitted else before)
        return float(np.sqrt(np.mean(miss**2))) / tracker
    trace = with_it.outside[rows] - without.outside[rows]
    if kind.channel == "reported":
        trace = (with_it.reported - with_it.outside - without.reported + without.outside)[rows]
    each = np.sqrt(np.mean(trace**2, axis=0)) / noise
    return float(each[j] if kind.where == "joint" else each.max())


def _rigidly(points: Array, onto: Array) -> Array:
    """Points `(n, 3)` after the best rigid motion onto others (Kabsch 1976)."""
    a, b = points.mean(axis=0), onto.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - a).T @ (onto - b))
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    moved: Array = (points - a) @ turn + b
    return moved


def clamped(hidden: Hidden) -> Hidden:
    """Return the cause with its numbers inside what is physical."""
    params = dict(hidden.params)
    for name, (low, high) in PHYSICAL.get(hidden.name, {}).items():
        params[name] = float(np.clip(params[name], low, high))
    return replace(hidden, params=params)


def grown(hidden: Hidden, target: float, measure: Callable[[Hidden], float]) -> Hidden:
    """Return the cause scaled until its measured ratio meets the target, as nearly as the physical range lets it.

    Secant steps on logarithms of factor and ratio, halving where a step leaves the bracket.
    """
    kind = kind_named(hidden.name)
    x, low, high = 0.0, -np.inf, np.inf
    best, best_miss, known = hidden, np.inf, (np.nan, np.nan)
    for _ in range(TRIES):
        trial = clamped(replace(hidden, params=scaled(kind, hidden.params, float(np.exp(x)))))
        miss = float(np.log(max(measure(trial), 1e-5) / target))
        if abs(miss) < best_miss:
            best, best_miss = trial, abs(miss)
        if abs(miss) < CLOSE:
            break
        low, high = (max(low, x), high) if miss < 0 else (low, min(high, x))
        slope = (miss - known[1]) / (x - known[0]) if x != known[0] else np.nan
        known = (x, miss)
        step = -miss / (slope if np.isfinite(slope) and 0.1 < slope < 1e3 else 1.0)
        x += float(np.clip(step, -STRIDE, STRIDE))
        if not low < x < high:
            x = 0.5 * (low + high)
    return best
