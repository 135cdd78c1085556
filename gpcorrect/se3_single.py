"""The rotation maths of `se3` for one rotation at a time: the hot path of `correct`, where a stack costs far more.

Plain floats and no scipy; every function agrees with its namesake in :mod:`gpcorrect.se3` to rounding (tested).
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from gpcorrect.types import FloatArray

__all__ = ["matrix_from_quaternion", "matrix_from_rotvec", "quaternion_from_matrix", "rotvec_from_matrix"]

SMALL = 1e-6  # rad: below it sin(x) / x is 1 to rounding


def matrix_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix `(3, 3)` of one unit quaternion wxyz `(4,)`."""
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_matrix(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion wxyz `(4,)` with w >= 0 of one rotation matrix `(3, 3)` (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = squares.index(max(squares))
    q = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[largest]
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = (-1.0 if q[0] < 0 else 1.0) / norm
    return np.array([q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale])


def matrix_from_rotvec(rotvec: FloatArray) -> FloatArray:
    """Rotation matrix `(3, 3)` of one rotation vector `(3,)`, rad."""
    x, y, z = rotvec.tolist()
    angle = sqrt(x * x + y * y + z * z)
    half = 0.5 if angle < SMALL else sin(angle / 2) / angle
    return matrix_from_quaternion(np.array([cos(angle / 2), half * x, half * y, half * z]))


def rotvec_from_matrix(rotation: FloatArray) -> FloatArray:
    """Rotation vector `(3,)`, rad, of length at most pi, of one rotation matrix `(3, 3)`."""
    w, x, y, z = quaternion_from_matrix(rotation).tolist()
    sine = sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < SMALL else 2 * atan2(sine, w) / sine
    return np.array([factor * x, factor * y, factor * z])
