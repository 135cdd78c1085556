"""Rigid motions: the only rotation maths of the project, on scipy's Rotation.

Poses are homogeneous matrices `(..., 4, 4)`; a tangent vector is `(..., 6)`: translation part first (m), then
the rotation vector (rad), as in a twist. Quaternions are wxyz. Every function takes and returns stacks and
broadcasts over leading axes. A missing sample (NaN) stays missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

SMALL_ANGLE = 1e-4  # below it the series of order 4 is exact to rounding


def matrix_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation matrices `(..., 3, 3)` of quaternions wxyz `(..., 4)`, normalised first.

    Parameters
    ----------
    quaternion : (..., 4) array
        Quaternions wxyz, of any length but zero.

    Raises
    ------
    DataError
        A quaternion is zero: it has no direction.
    """
    q = np.asarray(quaternion, dtype=np.float64)
    if (q == 0.0).all(axis=-1).any():
        raise DataError("a quaternion of zeros is no rotation.", hint="Mark missing samples with NaN.")
    return _map_rows(q, (3, 3), lambda rows: _rotations().from_quat(rows, scalar_first=True).as_matrix(), axes=1)


def quaternion_from_matrix(rotation: FloatArray) -> FloatArray:
    """Return unit quaternions wxyz `(..., 4)` with w >= 0 of rotation matrices `(..., 3, 3)`.

    Parameters
    ----------
    rotation : (..., 3, 3) array
    """
    from_matrix = _rotations().from_matrix
    return _map_rows(rotation, (4,), lambda rows: from_matrix(rows).as_quat(canonical=True, scalar_first=True), axes=2)


def matrix_from_rotvec(rotvec: FloatArray) -> FloatArray:
    """Rotation matrices `(..., 3, 3)` of rotation vectors `(..., 3)` in rad.

    Parameters
    ----------
    rotvec : (..., 3) array
    """
    return _map_rows(rotvec, (3, 3), lambda rows: _rotations().from_rotvec(rows).as_matrix(), axes=1)


def matrix_from_euler(angles: FloatArray, order: str) -> FloatArray:
    """Rotation matrices `(..., 3, 3)` of Euler angles `(..., 3)` in rad.

    Parameters
    ----------
    angles : (..., 3) array
        Each about the axes as the turns before left them, in the order of the turns, rad.
    order : str
        Axes of the turns: "ZYX" is R = Rz Ry Rx.
    """
    return _map_rows(angles, (3, 3), lambda rows: _rotations().from_euler(order, rows).as_matrix(), axes=1)


def rotvec_from_matrix(rotation: FloatArray) -> FloatArray:
    """Rotation vectors `(..., 3)` in rad, of length at most pi, of rotation matrices `(..., 3, 3)`.

    Parameters
    ----------
    rotation : (..., 3, 3) array
    """
    return _map_rows(rotation, (3,), _rotvecs, axes=2)


def _rotvecs(rotation: FloatArray) -> FloatArray:
    """Return rotation vectors `(n, 3)`: below a quarter turn from the skew part, exact and ten times as fast."""
    skew = 0.5 * (rotation - rotation.swapaxes(1, 2))
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    cosine = 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0)
    small = sine < SMALL_ANGLE
    factor = np.where(small, 1.0 + sine**2 / 6.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))
    result: FloatArray = axis * factor[:, None]
    far = cosine <= 0.0
    if far.any():
        result[far] = _rotations().from_matrix(rotation[far]).as_rotvec()
    return result


@cache
def _rotations() -> type[Rotation]:
    """Return scipy's rotations, imported when first needed: they take three times as long as numpy."""
    from scipy.spatial import transform

    rotations: type[Rotation] = transform.Rotation
    return rotations


def _map_rows(
    value: FloatArray, shape: tuple[int, ...], convert: Callable[[FloatArray], FloatArray], axes: int
) -> FloatArray:
    """Apply `convert` to a stack whose last `axes` axes are one rotation; rows with NaN give NaN."""
    array = np.asarray(value, dtype=np.float64)
    lead, tail = array.shape[: array.ndim - axes], array.shape[array.ndim - axes :]
    rows = array.reshape(math.prod(lead), *tail)
    finite = np.isfinite(rows).all(axis=tuple(range(1, rows.ndim)))
    result = np.full((len(rows), *shape), np.nan)
    if finite.any():
        result[finite] = convert(rows[finite])
    return result.reshape(*lead, *shape)


def angle(rotation: FloatArray) -> FloatArray:
    """Rotation angles `(...)` in rad, 0 to pi, of rotation matrices `(..., 3, 3)`.

    Parameters
    ----------
    rotation : (..., 3, 3) array
    """
    lengths: FloatArray = np.linalg.norm(rotvec_from_matrix(rotation), axis=-1)
    return lengths


def quaternion_angle(first: FloatArray, second: FloatArray) -> FloatArray:
    """Angles `(...)` in rad, 0 to pi, between quaternions `(..., 4)` and `(..., 4)`, accurate near zero.

    Parameters
    ----------
    first, second : (..., 4) arrays, not zero; normalised first
    """
    q, r = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (first, second))
    aligned = np.where((q * r).sum(axis=-1) < 0, -1.0, 1.0)[..., None] * r
    angles: FloatArray = 4 * np.arcsin(np.minimum(np.linalg.norm(aligned - q, axis=-1) / 2, 1.0))
    return angles


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Rotation matrices `(..., 3, 3)` nearest to `matrix` in the Frobenius norm (SVD, determinant +1).

    Parameters
    ----------
    matrix : (..., 3, 3) array

    Raises
    ------
    DataError
        A number is missing: nothing is nearest to it.
    """
    if not np.isfinite(matrix).all():
        raise DataError("the nearest rotation of a matrix with NaN or infinity does not exist.")
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=np.float64))
    signs = np.ones(u.shape[:-1])
    signs[..., -1] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation: FloatArray = (u * signs[..., None, :]) @ vt
    return rotation


def pose(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Pose matrices `(..., 4, 4)` of rotations `(..., 3, 3)` and translations `(..., 3)`.

    Parameters
    ----------
    rotation : (..., 3, 3) array
    translation : (..., 3) array
    """
    r, t = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    lead = np.broadcast_shapes(r.shape[:-2], t.shape[:-1])
    T = np.zeros((*lead, 4, 4))
    T[..., :3, :3] = r
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def from_parts(position: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Pose matrices `(..., 4, 4)` of positions `(..., 3)` and quaternions wxyz `(..., 4)`.

    Parameters
    ----------
    position : (..., 3) array
    quaternion : (..., 4) array
    """
    return pose(matrix_from_quaternion(quaternion), position)


def to_parts(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions `(..., 3)` and quaternions wxyz `(..., 4)` of pose matrices `(..., 4, 4)`.

    Parameters
    ----------
    T : (..., 4, 4) array
    """
    return np.array(T[..., :3, 3]), quaternion_from_matrix(T[..., :3, :3])


def compose(*poses: FloatArray) -> FloatArray:
    """Product of poses, left to right: `compose(T_a_b, T_b_c)` is `T_a_c`."""
    product = np.asarray(poses[0], dtype=np.float64)
    for T in poses[1:]:
        one_for_all = T.ndim == 2 and product.ndim > 2 and product.flags.c_contiguous
        product = (product.reshape(-1, 4) @ T).reshape(product.shape) if one_for_all else product @ T
    return product


def invert(T: FloatArray) -> FloatArray:
    """Inverse poses: `invert(T_a_b)` is `T_b_a`.

    Parameters
    ----------
    T : (..., 4, 4) array
    """
    r_t = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(r_t, -(r_t @ T[..., :3, 3, None])[..., 0])


def hat(v: FloatArray) -> FloatArray:
    """Return cross-product matrices `(..., 3, 3)`: `hat(v) @ w` is `v x w`.

    Parameters
    ----------
    v : (..., 3) array
    """
    upper = np.zeros((*v.shape[:-1], 3, 3))
    upper[..., 0, 1], upper[..., 0, 2], upper[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return upper - np.swapaxes(upper, -1, -2)


def _left_jacobian(rotvec: FloatArray) -> FloatArray:
    """V of the exponential: exp(rho, phi) has translation V(phi) rho (Barfoot 2017, Eq. 7.37)."""
    theta = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = theta < SMALL_ANGLE
    safe = np.where(small, 1.0, theta)
    a = np.sinc(theta / (2 * np.pi)) ** 2 / 2  # (1 - cos) / theta^2 without its cancellation
    b = np.where(small, 1 / 6 - theta**2 / 120, (safe - np.sin(safe)) / safe**3)
    cross = hat(rotvec)
    jacobian: FloatArray = np.eye(3) + a * cross + b * (cross @ cross)
    return jacobian


def left_jacobian_inverse(rotvec: FloatArray) -> FloatArray:
    """Map `(..., 3, 3)` from spatial angular velocity to the rate of the rotation vector `(..., 3)`.

    The inverse of V in closed form, finite up to and including an angle of pi (Barfoot 2017, Eq. 7.36).

    Parameters
    ----------
    rotvec : (..., 3) array
    """
    theta = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = theta < SMALL_ANGLE
    half = np.where(small, 1.0, theta) / 2
    c = np.where(small, 1 / 12 + theta**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    cross = hat(rotvec)
    return np.eye(3) - 0.5 * cross + c * (cross @ cross)


def exp(xi: FloatArray) -> FloatArray:
    """Pose matrices `(..., 4, 4)` of tangent vectors `(..., 6)`: exponential map of SE(3).

    Parameters
    ----------
    xi : (..., 6) array
        Translation part (m), then rotation vector (rad).
    """
    xi = np.asarray(xi, dtype=np.float64)
    translation = (_left_jacobian(xi[..., 3:]) @ xi[..., :3, None])[..., 0]
    return pose(matrix_from_rotvec(xi[..., 3:]), translation)


def log(T: FloatArray) -> FloatArray:
    """Tangent vectors `(..., 6)` of pose matrices `(..., 4, 4)`; undoes :func:`exp` for angles below pi.

    Parameters
    ----------
    T : (..., 4, 4) array
    """
    rotvec = rotvec_from_matrix(T[..., :3, :3])
    rho = (left_jacobian_inverse(rotvec) @ T[..., :3, 3, None])[..., 0]
    return np.concatenate([rho, rotvec], axis=-1)


def rotation_mean(rotations: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Chordal mean `(3, 3)` of rotation matrices `(n, 3, 3)` (Markley et al. 2007).

    Parameters
    ----------
    rotations : (n, 3, 3) array
    weights : (n,) array, optional
        Non-negative weights; equal when not given.

    Raises
    ------
    DataError
        There is no rotation to average.
    """
    if len(rotations) == 0:
        raise DataError("the mean of no rotations does not exist.", hint="Give at least one rotation.")
    matrix: FloatArray = _rotations().from_matrix(rotations).mean(weights).as_matrix()
    return matrix


def interpolate_rotations(times: FloatArray, rotations: FloatArray, at: FloatArray) -> FloatArray:
    """Rotations `(m, 3, 3)` at times `at` (m,): shortest arcs at constant speed between samples `(n, 3, 3)`.

    Parameters
    ----------
    times : (n,) array, times of the samples, s
    rotations : (n, 3, 3) array, rotation matrices there
    at : (m,) array, times to interpolate at, s

    Raises
    ------
    DataError
        There are fewer than two samples, `times` (n,) do not increase, or `at` lies outside them; the caller
        decides what a gap means.
    """
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise DataError("interpolation needs at least two samples with increasing times.")
    if at.size and not (at.min() >= times[0] and at.max() <= times[-1]):
        asked, have = f"{at.min()} to {at.max()}", f"{times[0]} to {times[-1]}"
        raise DataError(f"interpolation was asked for {asked} s, samples cover {have} s.")
    index = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    fraction = (at - times[index]) / (times[index + 1] - times[index])
    step = rotvec_from_matrix(rotations[index + 1] @ np.swapaxes(rotations[index], -1, -2))
    return matrix_from_rotvec(fraction[:, None] * step) @ rotations[index]
