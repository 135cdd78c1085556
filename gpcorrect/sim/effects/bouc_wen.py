"""The Bouc-Wen element: hysteresis that takes up ever less of a motion after each reversal, compiled."""

from __future__ import annotations

from functools import lru_cache
from math import isnan

import numpy as np
from numba import njit

from gpcorrect.sim.effects.operators import Memory, as_columns, remembered
from gpcorrect.types import FloatArray

# Of the table of a Bouc-Wen element's loading curve, chosen by hand so that it agrees with an ODE solver to 1e-5 of the
# width (tests/sim/test_sim_operators.py).
FINEST, COARSEST = 1e-3, 0.05  # widths of travel between nodes: near the start, where z^n bends, and beyond
GROWTH = 1.1  # of a step over the one before
SETTLED = 1e-12  # of a width: what is left of the way to saturation at the last node
ITERATIONS = 3  # of Newton's method inside one step, where the curve is nearly straight


def bouc_wen(path: FloatArray, width: float, sharpness: float, memory: Memory | None = None) -> FloatArray:
    """Hysteretic part of a path: `dz = (1 - |z / w|^n) du` while it loads, `dz = du` while it unloads.

    The Bouc-Wen element with A = 1 and beta = gamma, written for displacements: it takes up all motion after a reversal
    and ever less of it, `width` at most (Ismail, Ikhouane and Rodellar 2009, Arch. Comput. Methods Eng. 16, Sec. 2). It
    depends on the path alone, not on its speed, and starts relaxed.

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    width : float
        Largest value of the output, w, in the unit of the path.
    sharpness : float
        Exponent n > 0; the larger, the more it is like the part that a play of radius w takes off.
    memory : dict, optional
        Moved on; see the module.

    Returns
    -------
    (n, ...) array
        Output, between -w and w.
    """
    if width == 0:
        return np.zeros(path.shape)
    columns = as_columns(path) / width
    z = _bouc_wen(columns, _loading_curve(sharpness), remembered(memory, 2, columns))
    return (width * z).reshape(path.shape)


@njit(cache=True)
def _bouc_wen(path: FloatArray, curve: FloatArray, state: FloatArray) -> FloatArray:
    """Of a path in widths."""
    output = np.full(path.shape, np.nan)
    for j in range(path.shape[1]):
        last, z = state[0, j], state[1, j]
        for i in range(len(path)):
            u = path[i, j]
            if isnan(u):
                continue
            z = 0.0 if isnan(last) else _travelled(curve, z, u - last)
            last, output[i, j] = u, z
        state[0, j], state[1, j] = last, z
    return output


@njit(cache=True)
def _travelled(curve: FloatArray, z: float, travel: float) -> float:
    """Return a Bouc-Wen state after a travel in one direction, in widths: straight back to zero, then the curve."""
    direction = 1.0 if travel > 0 else -1.0
    z, left = z * direction, abs(travel)
    if z < 0.0:
        unloaded = min(-z, left)
        z, left = z + unloaded, left - unloaded
    return direction * (_along_curve(curve, z, left) if left > 0.0 else z)


@lru_cache(maxsize=8)
@njit(cache=True)
def _loading_curve(sharpness: float) -> FloatArray:
    """Curve along which a Bouc-Wen element loads, `dz/du = 1 - z^n` from z = 0, for an exponent n > 0.

    Every stretch of loading is a stretch of this one curve, whatever the path: where it begins depends on the state,
    and where it ends on the way. Nodes `(3, m)`: travel, state (in widths) and slope, from 0 to saturation.
    """
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
def _along_curve(curve: FloatArray, z: float, travel: float) -> float:
    """State after loading from z in [0, 1] over a travel >= 0, both in widths."""
    last = curve.shape[1] - 1
    if z >= curve[1, last]:
        return z
    k = int(np.searchsorted(curve[1], z, side="right")) - 1
    beyond = 0.0  # travel from node k at which the curve reaches z, by Newton's method
    for _ in range(ITERATIONS):
        here, slope = _between(curve, k, beyond)
        beyond += (z - here) / slope
    u = curve[0, k] + beyond + travel
    if u >= curve[0, last]:
        return 1.0
    k = int(np.searchsorted(curve[0], u, side="right")) - 1
    return min(max(_between(curve, k, u - curve[0, k])[0], z), 1.0)


@njit(cache=True)
def _between(curve: FloatArray, k: int, beyond: float) -> tuple[float, float]:
    """State and slope a travel beyond node k: the cubic through two nodes with their slopes."""
    h = curve[0, k + 1] - curve[0, k]
    chord = (curve[1, k + 1] - curve[1, k]) / h
    b = (3.0 * chord - 2.0 * curve[2, k] - curve[2, k + 1]) / h
    c = (curve[2, k] + curve[2, k + 1] - 2.0 * chord) / h**2
    state = curve[1, k] + beyond * (curve[2, k] + beyond * (b + beyond * c))
    return state, curve[2, k] + beyond * (2.0 * b + 3.0 * beyond * c)
