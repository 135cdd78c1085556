"""Check a query once, at the edge: finite, unit quaternion, the right numbers in the right order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["QUATERNION_TOLERANCE", "checked_pose", "checked_poses", "checked_times", "checked_twist"]

QUATERNION_TOLERANCE = 1e-3  # as for recorded samples: a norm further from one is a mistake, not rounding
POSE, POSITION, TWIST = 7, 3, 6


def checked_pose(pose: ArrayLike, *, orientation: bool) -> FloatArray:
    """Return one pose as `(7,)` with its quaternion normalised, or `(3,)` for a position-only model.

    Raises
    ------
    DataError
        Wrong length, not finite, or a quaternion that is not a unit quaternion.
    """
    one: FloatArray = checked_poses(np.asarray(pose, dtype=np.float64)[None], orientation=orientation)[0]
    return one


def checked_poses(poses: ArrayLike, *, orientation: bool) -> FloatArray:
    """Return poses as `(n, 7)` with normalised quaternions, or `(n, 3)` for a position-only model.

    A position-only model takes poses with an orientation too, and keeps the orientation for the caller.

    Raises
    ------
    DataError
        As :func:`checked_pose`.
    """
    values = np.array(poses, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] not in (POSITION, POSE):
        raise DataError(
            f"a pose is 7 numbers (x y z qw qx qy qz) or 3 (x y z), got an array of shape {values.shape[1:]}.",
            hint="Give metres and a unit quaternion in the order w x y z.",
        )
    if orientation and values.shape[1] != POSE:
        raise DataError(
            "this model corrects orientations too and needs 7 numbers a pose, got 3.", hint="Add qw qx qy qz."
        )
    if not np.isfinite(values).all():
        raise DataError("the pose holds a number that is not finite.", hint="Send only complete poses.")
    if values.shape[1] == POSE:
        values[:, POSITION:] = _unit(values[:, POSITION:])
    return values


def _unit(quaternions: FloatArray) -> FloatArray:
    norms = np.linalg.norm(quaternions, axis=1)
    worst = int(np.argmax(np.abs(norms - 1)))
    if abs(norms[worst] - 1) > QUATERNION_TOLERANCE:
        raise DataError(
            f"quaternion {worst} has norm {norms[worst]:.6g}, not 1.",
            hint="The order is qw qx qy qz; normalise it first.",
        )
    unit: FloatArray = quaternions / norms[:, None]
    return unit


def checked_twist(twist: ArrayLike) -> FloatArray:
    """Return a twist as `(6,)`: m/s, then rad/s; three numbers are a linear velocity.

    Raises
    ------
    DataError
        Wrong length or not finite.
    """
    values = np.array(twist, dtype=np.float64)
    if values.shape not in ((TWIST,), (POSITION,)):
        raise DataError(f"a twist is 6 numbers (vx vy vz wx wy wz), got an array of shape {values.shape}.")
    if not np.isfinite(values).all():
        raise DataError(
            "the twist holds a number that is not finite.", hint="Leave the twist out where it is not known."
        )
    return np.concatenate([values, np.zeros(TWIST - len(values))])


def checked_times(times: ArrayLike, count: int) -> FloatArray:
    """Return the times of a path as `(count,)`, s.

    Raises
    ------
    DataError
        Wrong length, not finite, or not strictly increasing.
    """
    values = np.array(times, dtype=np.float64)
    if values.shape != (count,):
        raise DataError(f"a path of {count} poses needs {count} times, got an array of shape {values.shape}.")
    if not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        raise DataError("the times of a path must be finite and strictly increasing.", hint="Times are seconds.")
    return values
