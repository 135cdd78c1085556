"""Orientations as foreign tables write them, turned into unit quaternions wxyz; no rotation becomes NaN."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gpcorrect import se3
from gpcorrect.types import FloatArray

__all__ = ["CONVERTERS", "quaternion_from_euler", "unit_quaternions"]

NORM_TOLERANCE = 1e-3  # of the log format: a quaternion further off is a bad sample
ROUNDING = 1e-12  # nearer to one than this a quaternion is left as it is, so that a written log reads back exactly


def unit_quaternions(quaternion: FloatArray) -> FloatArray:
    """Normalise quaternions `(n, 4)`; a row whose norm is off by more than 1e-3 becomes NaN."""
    with np.errstate(over="ignore"):  # an infinite norm is off by more than the tolerance
        norm = np.linalg.norm(quaternion, axis=1)
    result = np.array(quaternion, dtype=np.float64)
    off = np.abs(norm - 1.0)
    inexact = (off > ROUNDING) & (off <= NORM_TOLERANCE)
    result[inexact] /= norm[inexact, None]
    result[~(off <= NORM_TOLERANCE)] = np.nan
    return result


def _where_finite(convert: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    """Convert the rows `(n, k)` that are complete; the others become NaN quaternions."""
    complete = np.isfinite(values).all(axis=1)
    result = np.full((len(values), 4), np.nan)
    result[complete] = convert(values[complete])
    return result


def _from_xyzw(values: FloatArray) -> FloatArray:
    return unit_quaternions(values[:, [3, 0, 1, 2]])


def _from_rotvec(values: FloatArray) -> FloatArray:
    return _where_finite(lambda v: se3.quaternion_from_matrix(se3.matrix_from_rotvec(v)), values)


def quaternion_from_euler(angles: FloatArray, order: str) -> FloatArray:
    """Turn Euler angles, each about the axes as the turns before left them, into unit quaternions wxyz `(n, 4)`.

    Parameters
    ----------
    angles : (n, 3) array
        About x, y and z, in this order whatever the order of the turns, rad.
    order : str
        Order of the turns: "ZYX" is R = Rz Ry Rx.
    """

    def convert(values: FloatArray) -> FloatArray:
        turns = {axis: se3.matrix_from_rotvec(values[:, k, None] * np.eye(3)[k]) for k, axis in enumerate("XYZ")}
        first, second, third = (turns[axis] for axis in order)
        return se3.quaternion_from_matrix(first @ second @ third)

    return _where_finite(convert, angles)


def _from_rpy(values: FloatArray) -> FloatArray:
    """Roll, pitch, yaw in rad about the fixed x, y and z axes, in this order: R = Rz Ry Rx."""
    return quaternion_from_euler(values, "ZYX")


def _from_rpy_deg(values: FloatArray) -> FloatArray:
    return _from_rpy(np.deg2rad(values))


def _from_matrix(values: FloatArray) -> FloatArray:
    """Row-major 3 x 3 matrices `(n, 9)`; one not orthonormal and right-handed within 1e-3 is no rotation."""

    def convert(flat: FloatArray) -> FloatArray:
        matrix = flat.reshape(-1, 3, 3)
        bounded = np.abs(matrix).max(axis=(1, 2), initial=0.0) < 2.0  # others would overflow
        matrix = np.where(bounded[:, None, None], matrix, 0.0)
        skew = np.abs(matrix @ np.swapaxes(matrix, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        proper = (skew <= NORM_TOLERANCE) & (np.linalg.det(matrix) > 0)
        result = np.full((len(flat), 4), np.nan)
        result[proper] = se3.quaternion_from_matrix(se3.nearest_rotation(matrix[proper]))
        return result

    return _where_finite(convert, values)


CONVERTERS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "quat_wxyz": unit_quaternions,
    "quat_xyzw": _from_xyzw,
    "rotvec": _from_rotvec,
    "rpy": _from_rpy,
    "rpy_deg": _from_rpy_deg,
    "matrix": _from_matrix,
}
"""Orientation columns of a mapping file to quaternions wxyz `(n, 4)`, by the key's name."""
