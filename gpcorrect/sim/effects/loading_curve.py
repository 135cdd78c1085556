"""The curve along which a Bouc-Wen element loads, `dz/du = 1 - z^n` from z = 0, as a table with its slopes.

Every stretch of loading is a stretch of this one curve, whatever the path: where it begins depends on the state, and
where it ends on the way. It is integrated once for an exponent, finely, and then only looked up.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray

__all__ = ["along_curve", "loading_curve"]

FINEST, COARSEST = 1e-3, 0.05  # widths of travel between nodes: near the start, where z^n bends, and beyond
GROWTH = 1.1  # of a step over the one before
SETTLED = 1e-12  # of a width: what is left of the way to saturation at the last node
ITERATIONS = 3  # of Newton's method inside one step, where the curve is nearly straight


@njit(cache=True)
def loading_curve(sharpness: float) -> FloatArray:
    """Nodes `(3, m)` of the curve for an exponent n > 0: travel, state (in widths) and slope, from 0 to saturation."""
    travel, state, slope = [0.0], [0.0], [1.0]
    u, z, step, longest = 0.0, 0.0, FINEST, min(COARSEST, 0.2 / sharpness)
    while 1.0 - z > SETTLED:
        h = min(step, longest)
        a = 1.0 - z**sharpness
        b = 1.0 - max(z + 0.5 * h * a, 0.0) ** sharpness
        c = 1.0 - max(z + 0.5 * h * b, 0.0) ** sharpness
        d = 1.0 - max(z + h * c, 0.0) ** sharpness
        u, z = u + h, min(z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d), 1.0)
        travel.append(u)
        state.append(z)
        slope.append(1.0 - z**sharpness)
        step *= GROWTH
    return np.stack((np.array(travel), np.array(state), np.array(slope)))


@njit(cache=True)
def along_curve(curve: FloatArray, z: float, travel: float) -> float:
    """State after loading from z in [0, 1] over a travel >= 0, both in widths."""
    last = curve.shape[1] - 1
    if z >= curve[1, last]:
        return z
    u = _travel_at(curve, z) + travel
    if u >= curve[0, last]:
        return 1.0
    k = int(np.searchsorted(curve[0], u, side="right")) - 1
    state: float = min(max(_between(curve, k, u - curve[0, k])[0], z), 1.0)
    return state


@njit(cache=True)
def _travel_at(curve: FloatArray, z: float) -> float:
    """Travel at which the curve reaches a state: Newton's method from the node below."""
    k = int(np.searchsorted(curve[1], z, side="right")) - 1
    beyond = 0.0
    for _ in range(ITERATIONS):
        here, slope = _between(curve, k, beyond)
        beyond += (z - here) / slope
    travel: float = curve[0, k] + beyond
    return travel


@njit(cache=True)
def _between(curve: FloatArray, k: int, beyond: float) -> tuple[float, float]:
    """State and slope a travel beyond node k: the cubic through two nodes with their slopes."""
    h = curve[0, k + 1] - curve[0, k]
    chord = (curve[1, k + 1] - curve[1, k]) / h
    b = (3.0 * chord - 2.0 * curve[2, k] - curve[2, k + 1]) / h
    c = (curve[2, k] + curve[2, k + 1] - 2.0 * chord) / h**2
    state = curve[1, k] + beyond * (curve[2, k] + beyond * (b + beyond * c))
    return state, curve[2, k] + beyond * (2.0 * b + 3.0 * beyond * c)
