"""One query in machine code, before and after the regression: `RigidModel.apply`, features and residual without stacks.

Every step agrees with its namesake for stacks to rounding (tested). All of it is in one file: numba's cache notices a
change of the file that holds the outermost function, and no other.
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import RigidModel
from gpcorrect.types import QUATERNION_TOLERANCE, FloatArray

SMALL = 1e-6  # rad: below it sin(x) / x is 1 to rounding
# m, m/s or rad/s: beyond it the numbers of a query overflow long before they mean anything. It stands beside its use,
# for numba's cache notices changes of this file only.
LARGEST = 1e6
NO_ROTATION, ROTVEC, COLUMNS, EULER = range(4)
ROTATIONS = {"none": NO_ROTATION, "rotvec": ROTVEC, "columns": COLUMNS, "euler": EULER}


class Frame(NamedTuple):
    """What a query needs of registration and features; `kind` holds the rotation's code and the twist's length."""

    R_position: FloatArray
    t: FloatArray
    offset: FloatArray
    R_left: FloatArray
    R_right: FloatArray
    R_mean: FloatArray
    spread: FloatArray
    kind: FloatArray


def frame(rigid: RigidModel, features: FeatureMap, memory: int = 0) -> Frame:
    """Return what queries read of a registration and its features, with room for features of `memory` behind them.

    Copies, so that every array is contiguous.

    Parameters
    ----------
    rigid : RigidModel, from the observer's frame to the command's
    features : FeatureMap, of poses and twists
    memory : int, number of memory features
    """
    twist = (6 if features.has_orientation else 3) if features.uses_velocity else 0
    kind = np.array([ROTATIONS[features.rotation], twist], dtype=np.float64)
    spread = np.concatenate([features.spread, np.ones(memory)])
    parts = (rigid.R_position, rigid.t, rigid.offset, rigid.R_left, rigid.R_right, features.R_mean, spread, kind)
    return Frame(*(np.array(part, order="C") for part in parts))


@njit(cache=True, nogil=True)
def inputs(
    pose: FloatArray, twist: FloatArray, memory: FloatArray, f: Frame, region: FloatArray
) -> tuple[bool, FloatArray, FloatArray, FloatArray, bool]:
    """Return the reference pose G(x) and the regression's input for one query.

    Parameters
    ----------
    pose : (7,) or (3,) array, desired pose, observer's frame
    twist : (6,) array, m/s and rad/s, observer's frame
    memory : (h,) array, memory features; none for a query without history
    f : Frame
    region : (2, d) array, lower and upper bounds of the inputs before the memory features

    Returns
    -------
    good : bool, whether every number is below `LARGEST` and the quaternion a unit one; the rest means nothing otherwise
    position, rotation : (3,) and (3, 3) arrays, of the reference; no rotation without a quaternion
    x : (d,) array
    near : bool, whether the inputs lie inside their bounds
    """
    kind, moving = int(f.kind[0]), int(f.kind[1])
    turned = 0 if kind == NO_ROTATION else 6 if kind == COLUMNS else 3
    if 3 + turned + moving + len(memory) != len(f.spread):  # before anything is written
        raise ValueError("the features do not fit the frame")
    x, rotation = np.empty(len(f.spread)), np.zeros((3, 3))
    rotation[0, 0] = rotation[1, 1] = rotation[2, 2] = 1.0
    if not (_sane(pose) and _sane(twist)):
        return False, pose, rotation, x, False
    oriented = len(pose) == 7
    linear, arm = np.empty(3), np.zeros(3)
    _write(twist[:3], linear, 0)
    if oriented:
        norm = sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            return False, pose, rotation, x, False
        q = np.empty(4)
        for i in range(4):
            q[i] = pose[3 + i] / norm
        R_obs = _matrix_from_quaternion(q)
        arm = _turn(R_obs, f.offset)
        _add(linear, _cross(twist[3:], arm))
        rotation = _product(_product(f.R_left, R_obs), f.R_right)
    _add(arm, pose)
    position = _turn(f.R_position, arm)
    _add(position, f.t)
    _write(position, x, 0)
    _write_rotation(rotation, f, x)
    filled = 3 + turned
    if moving > 0:
        _write(_turn(f.R_position, linear), x, filled)
    if moving > 3:
        _write(_turn(f.R_left, twist[3:]), x, filled + 3)
    _write(memory, x, filled + moving)
    for i in range(len(x)):
        x[i] /= f.spread[i]
    return True, position, rotation, x, _between(x, region)


@njit(cache=True, nogil=True)
def command(
    position: FloatArray, rotation: FloatArray, mean: FloatArray, bounds: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Return the command for a reference and its residual: position, quaternion, and whether a bound acted.

    Parameters
    ----------
    position, rotation : (3,) and (3, 3) arrays, of the reference
    mean : (6,) or (3,) array, residual, m and rad
    bounds : (2,) array, longest believed residual: m and rad
    """
    shift, cut = _shortened(mean[:3], bounds[0])
    if len(mean) > 3:
        turn, cut_turn = _shortened(mean[3:], bounds[1])
        rotation = _product(_matrix_from_rotvec(turn), rotation)
        cut = cut or cut_turn
    _add(shift, position)
    return shift, _quaternion_from_matrix(rotation), cut


@njit(cache=True)
def _matrix_from_quaternion(q: FloatArray) -> FloatArray:
    """Rotation matrix `(3, 3)` of one unit quaternion wxyz `(4,)`."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return R


@njit(cache=True)
def _quaternion_from_matrix(R: FloatArray) -> FloatArray:
    """Return the unit quaternion wxyz `(4,)` with w >= 0 of one rotation matrix `(3, 3)` (Shepperd 1978)."""
    q = np.empty(4)
    q[0], q[1] = 1 + R[0, 0] + R[1, 1] + R[2, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2]
    q[2], q[3] = 1 - R[0, 0] + R[1, 1] - R[2, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2]
    largest = 0
    for i in range(1, 4):
        if q[i] > q[largest]:
            largest = i
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, g = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    if largest == 0:
        q[1], q[2], q[3] = a, b, c
    elif largest == 1:
        q[0], q[2], q[3] = a, d, e
    elif largest == 2:
        q[0], q[1], q[3] = b, d, g
    else:
        q[0], q[1], q[2] = c, e, g
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = (-1.0 if q[0] < 0 else 1.0) / norm
    for i in range(4):
        q[i] *= scale
    return q


@njit(cache=True)
def _matrix_from_rotvec(rotvec: FloatArray) -> FloatArray:
    """Rotation matrix `(3, 3)` of one rotation vector `(3,)`, rad."""
    angle = _length(rotvec)
    q = np.empty(4)
    q[0] = cos(angle / 2)
    scale = 0.5 if angle < SMALL else sin(angle / 2) / angle
    for i in range(3):
        q[1 + i] = rotvec[i] * scale
    return _matrix_from_quaternion(q)


@njit(cache=True)
def _rotvec_from_matrix(R: FloatArray) -> FloatArray:
    """Rotation vector `(3,)`, rad, of length at most pi, of one rotation matrix `(3, 3)`."""
    q = _quaternion_from_matrix(R)
    sine = _length(q[1:])
    scale = 2.0 if sine < SMALL else 2 * atan2(sine, q[0]) / sine
    rotvec = np.empty(3)
    for i in range(3):
        rotvec[i] = q[1 + i] * scale
    return rotvec


@njit(cache=True)
def _write_rotation(R: FloatArray, f: Frame, x: FloatArray) -> None:
    """Write the rotation's features behind the position's, see `gpr.features`."""
    kind = int(f.kind[0])
    if kind == COLUMNS:
        for i in range(3):
            x[3 + i], x[6 + i] = R[i, 0], R[i, 1]
    elif kind == EULER:
        angles, centre = _fixed_axes_angles(R), _fixed_axes_angles(f.R_mean)
        for i in range(3):
            x[3 + i] = centre[i] + (angles[i] - centre[i] + pi) % (2 * pi) - pi
    elif kind == ROTVEC:
        _write(_rotvec_from_matrix(_product(R, f.R_mean.T)), x, 3)


@njit(cache=True)
def _add(vector: FloatArray, by: FloatArray) -> None:
    """Add three numbers in place; array expressions take numba seconds to compile."""
    for i in range(3):
        vector[i] += by[i]


@njit(cache=True)
def _write(values: FloatArray, x: FloatArray, first: int) -> None:
    """Write `values` into `x` from place `first` on."""
    for i in range(len(values)):
        x[first + i] = values[i]


@njit(cache=True)
def _fixed_axes_angles(R: FloatArray) -> FloatArray:
    angles = np.empty(3)
    angles[0], angles[2] = atan2(R[2, 1], R[2, 2]), atan2(R[1, 0], R[0, 0])
    angles[1] = atan2(-R[2, 0], hypot(R[0, 0], R[1, 0]))
    return angles


@njit(cache=True)
def _between(x: FloatArray, region: FloatArray) -> bool:
    for i in range(region.shape[1]):  # noqa: SIM110 - numba compiles no generator
        if not region[0, i] <= x[i] <= region[1, i]:
            return False
    return True


@njit(cache=True)
def _shortened(vector: FloatArray, bound: float) -> tuple[FloatArray, bool]:
    scale = min(1.0, bound / max(_length(vector), 1e-300))
    out = np.empty(3)
    for i in range(3):
        out[i] = vector[i] * scale
    return out, scale < 1.0


@njit(cache=True)
def _product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Product of two 3 x 3 matrices: a call of BLAS costs more."""
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@njit(cache=True)
def _turn(R: FloatArray, v: FloatArray) -> FloatArray:
    out = np.empty(3)
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]
    return out


@njit(cache=True)
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@njit(cache=True)
def _length(v: FloatArray) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@njit(cache=True)
def _sane(values: FloatArray) -> bool:
    for value in values:  # noqa: SIM110 - numba compiles no generator
        if not abs(value) <= LARGEST:  # NaN too
            return False
    return True
