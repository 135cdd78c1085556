"""A chain in machine code: its frames, and Newton's method for the joints nearest to a pose.

All of it is in one file: numba's cache notices a change of the file that holds the outermost function, and no other.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from gpcorrect.types import BoolArray, FloatArray

NEWTON_STEPS = 40  # chosen by hand
NEWTON_LONGEST = 0.3  # rad or m: the first order says nothing of longer steps; chosen by hand
NEWTON_REST = 1e-9  # rad or m: a shorter step ends the iteration; chosen by hand
NEWTON_DAMPING = 1e-9  # keeps the step finite where joints move alike; chosen by hand


@njit(cache=True, nogil=True, error_model="numpy")
def walk(
    table: FloatArray,
    placements: FloatArray,
    turns: BoolArray,
    modified: bool,
    base: FloatArray,
    q: FloatArray,
    frames: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Write the frames of the last m links at joint values `(n, dof)` into `frames` `(n, m, 4, 4)`.

    `table` holds alpha, a, d, theta `(dof, 4)`, `placements` what comes before each row, or nothing. Link transforms
    are Craig's Rx(alpha) Tx(a) Rz(theta) Tz(d) where `modified`, else Rz(theta) Tz(d) Tx(a) Rx(alpha).
    """
    T = np.empty((4, 4))
    first = q.shape[1] - frames.shape[1]
    for k in range(q.shape[0]):
        _copy(base, T)
        for i in range(q.shape[1]):
            theta = table[i, 3] + (q[k, i] if turns[i] else 0.0)
            d = table[i, 2] + (0.0 if turns[i] else q[k, i])
            if len(placements):
                _place(T, placements[i])
            if modified:
                _turn(T, 1, 2, table[i, 0])
                _shift(T, 0, table[i, 1])
            _turn(T, 0, 1, theta)
            _shift(T, 2, d)
            if not modified:
                _shift(T, 0, table[i, 1])
                _turn(T, 1, 2, table[i, 0])
            if i >= first:
                _copy(T, frames[k, i - first])


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(T: FloatArray, to: FloatArray) -> None:  # pragma: no cover - compiled
    for row in range(4):
        for column in range(4):
            to[row, column] = T[row, column]


@njit(cache=True, nogil=True, error_model="numpy")
def _place(T: FloatArray, by: FloatArray) -> None:  # pragma: no cover - compiled
    """Multiply by a rigid motion, the last of the frame's moves."""
    for row in range(3):
        x, y, z = T[row, 0], T[row, 1], T[row, 2]
        for column in range(4):
            moved = x * by[0, column] + y * by[1, column] + z * by[2, column]
            T[row, column] = moved + (T[row, 3] if column == 3 else 0.0)


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


@njit(cache=True, nogil=True, error_model="numpy")
def descend(
    table: FloatArray,
    placements: FloatArray,
    turns: BoolArray,
    modified: bool,
    base: FloatArray,
    tool: FloatArray,
    T: FloatArray,
    q: FloatArray,
    length: float,
    left: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Move joint values `(n, dof)` to where poses `(n, 4, 4)` are nearest, and write what is `left` (n,)."""
    dof = q.shape[1]
    frames, J, e = np.empty((1, dof, 4, 4)), np.zeros((6, dof)), np.empty(6)
    for k in range(q.shape[0]):
        largest = np.inf
        for _ in range(NEWTON_STEPS):
            walk(table, placements, turns, modified, base, q[k : k + 1], frames)
            tip = frames[0, dof - 1] @ tool
            e[:3] = (T[k, :3, 3] - tip[:3, 3]) / length
            _rotation_vector(T[k], tip, e)
            for j in range(dof):
                carrier = frames[0, j] if modified else (frames[0, j - 1] if j else base)
                axis, arm = carrier[:3, 2], tip[:3, 3] - carrier[:3, 3]
                if turns[j]:
                    J[0, j] = (axis[1] * arm[2] - axis[2] * arm[1]) / length
                    J[1, j] = (axis[2] * arm[0] - axis[0] * arm[2]) / length
                    J[2, j] = (axis[0] * arm[1] - axis[1] * arm[0]) / length
                    J[3:, j] = axis
                else:
                    J[:3, j] = axis / length
                    J[3:, j] = 0.0
            normal = J.T @ J
            for j in range(dof):
                normal[j, j] *= 1.0 + NEWTON_DAMPING
                normal[j, j] += NEWTON_DAMPING
            step = np.linalg.solve(normal, J.T @ e)
            largest = np.abs(step).max()
            q[k] += step * min(1.0, NEWTON_LONGEST / largest) if largest > 0.0 else step
            if not largest > NEWTON_REST:
                break
        left[k] = np.sqrt((e**2).sum())
        if not largest <= NEWTON_REST:
            q[k] = np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def _rotation_vector(T: FloatArray, tip: FloatArray, e: FloatArray) -> None:  # pragma: no cover - compiled
    """Write the rotation vector of R_T R_tip^T into the last of `e`; near half a turn its length only is right."""
    R = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R[i, j] += T[i, k] * tip[j, k]
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0))
    factor = 0.5 * angle / sine if sine > 1e-12 else 0.5
    e[3], e[4], e[5] = factor * x, factor * y, factor * z
