"""Orientations as foreign tables write them, turned into unit quaternions wxyz; no rotation becomes NaN."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.types import QUATERNION_TOLERANCE, FloatArray

FULL_TURN = 2 * np.pi  # rad; most orientations of a tool are written as less
ROUNDING = 1e-12  # nearer to one than this a quaternion is left as it is, so that a written log reads back exactly


def unit_quaternions(quaternion: FloatArray) -> FloatArray:
    """Normalise quaternions; a row whose norm is off by more than 1e-3 becomes NaN.

    Parameters
    ----------
    quaternion : (n, 4) array, in any order of their components
    """
    with np.errstate(over="ignore"):  # an infinite norm is off by more than the tolerance
        norm = np.linalg.norm(quaternion, axis=1)
    result = np.array(quaternion, dtype=np.float64)
    off = np.abs(norm - 1.0)
    inexact = (off > ROUNDING) & (off <= QUATERNION_TOLERANCE)
    result[inexact] /= norm[inexact, None]
    result[~(off <= QUATERNION_TOLERANCE)] = np.nan
    return result


def quaternion_from_euler(angles: FloatArray, order: str) -> FloatArray:
    """Turn Euler angles, each about the axes as the turns before left them, into unit quaternions wxyz `(n, 4)`.

    Parameters
    ----------
    angles : (n, 3) array, about x, y and z, in this order whatever the order of the turns, rad
    order : str, order of the turns: "ZYX" is R = Rz Ry Rx
    """
    turns = ["XYZ".index(axis) for axis in order]
    return se3.quaternion_from_matrix(se3.matrix_from_euler(angles[:, turns], order))


def _nearest_rotations(flat: FloatArray) -> FloatArray:
    """Row-major 3 x 3 matrices `(n, 9)`; one not orthonormal and right-handed within 1e-3 is no rotation."""
    matrix = flat.reshape(-1, 3, 3)
    bounded = np.abs(matrix).max(axis=(1, 2)) < 2.0  # others would overflow
    matrix = np.where(bounded[:, None, None], matrix, 0.0)
    skew = np.abs(matrix @ np.swapaxes(matrix, 1, 2) - np.eye(3)).max(axis=(1, 2))
    proper = (skew <= QUATERNION_TOLERANCE) & (np.linalg.det(matrix) > 0)
    result = np.full(matrix.shape, np.nan)
    result[proper] = se3.nearest_rotation(matrix[proper])
    return result


def quaternions_of(signal: str, form: str, values: FloatArray) -> tuple[FloatArray, list[str]]:
    """Return the orientations of a signal as unit quaternions wxyz `(n, 4)`, and a remark on those that are none.

    Angles in radians of which most are more than a full turn are refused, with a LogError: they are degrees.

    Parameters
    ----------
    signal : str, that they are of
    form : str, a key of :data:`CONVERTERS`
    values : (n, k) array, as they came
    """
    known = np.asarray(np.isfinite(values).all(axis=1))
    if form in ("rotvec", "rpy") and known.any():
        with np.errstate(over="ignore"):
            size = float(np.median(np.linalg.norm(values[known], axis=1)))
        if size > FULL_TURN:
            mend = {
                "rpy": "rpy_deg takes angles in degrees.",
                "rotvec": "Rotation vectors are in radians: divide by 57.2958.",
            }
            raise LogError(
                f"{signal}: its {form} is {size:.3g} rad long in most samples: it looks like degrees.", hint=mend[form]
            )
    quaternion = CONVERTERS[form](values)
    bad = int((known & np.isnan(quaternion).any(axis=1)).sum())
    return quaternion, [f"{bad} samples of {signal} have no valid rotation; it counts as missing."] if bad else []


CONVERTERS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "quat_wxyz": unit_quaternions,
    "quat_xyzw": lambda values: unit_quaternions(values[:, [3, 0, 1, 2]]),
    "rotvec": lambda values: se3.quaternion_from_matrix(se3.matrix_from_rotvec(values)),
    "rpy": lambda values: quaternion_from_euler(values, "ZYX"),  # about the fixed x, y and z axes, in this order
    "rpy_deg": lambda values: quaternion_from_euler(np.deg2rad(values), "ZYX"),
    "matrix": lambda values: se3.quaternion_from_matrix(_nearest_rotations(values)),
}
"""Orientation columns of a mapping file to quaternions wxyz `(n, 4)`, by the key's name."""
