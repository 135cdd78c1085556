"""The walk along a chain, compiled: for whole paths the tip alone is needed, not every link's frame."""

from __future__ import annotations

import numpy as np
from numba import njit

from gpcorrect.types import BoolArray, FloatArray

__all__ = ["walk"]


@njit(cache=True, nogil=True, error_model="numpy")
def walk(
    table: FloatArray, turns: BoolArray, modified: bool, base: FloatArray, q: FloatArray, tips: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the last link's frame `(n, 4, 4)` at joint values `(n, dof)` into `tips`.

    Parameters
    ----------
    table : (dof, 4) array
        alpha, a, d, theta of each joint, rad and m.
    turns : (dof,) bool array
        Whether the joint value adds to theta, else to d.
    modified : bool
        Craig's order Rx(alpha) Tx(a) Rz(theta) Tz(d); else Rz(theta) Tz(d) Tx(a) Rx(alpha).
    base : (4, 4) array
        First table frame in the base frame.
    q : (n, dof) array
        Joint values.
    tips : (n, 4, 4) array
        Result.
    """
    for k in range(q.shape[0]):
        T = tips[k]
        T[:] = base
        for i in range(q.shape[1]):
            theta = table[i, 3] + (q[k, i] if turns[i] else 0.0)
            d = table[i, 2] + (0.0 if turns[i] else q[k, i])
            if modified:
                _turn(T, 1, 2, table[i, 0])
                _shift(T, 0, table[i, 1])
            _turn(T, 0, 1, theta)
            _shift(T, 2, d)
            if not modified:
                _shift(T, 0, table[i, 1])
                _turn(T, 1, 2, table[i, 0])


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(T: FloatArray, i: int, j: int, angle: float) -> None:  # pragma: no cover - compiled
    """Turn about the axis that is neither i nor j, the last of the frame's moves."""
    if angle == 0.0:
        return
    c, s = np.cos(angle), np.sin(angle)
    for row in range(3):
        x, y = T[row, i], T[row, j]
        T[row, i] = c * x + s * y
        T[row, j] = c * y - s * x


@njit(cache=True, nogil=True, error_model="numpy")
def _shift(T: FloatArray, axis: int, by: float) -> None:  # pragma: no cover - compiled
    for row in range(3):
        T[row, 3] += T[row, axis] * by
