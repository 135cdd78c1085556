"""Check a query once, at the edge: finite, unit quaternion, the right numbers in the right order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.calibration.one_pose import LARGEST
from gpcorrect.errors import DataError
from gpcorrect.types import QUATERNION_TOLERANCE, FloatArray, IntArray

POSE, POSITION, TWIST = 7, 3, 6


def numbers(values: ArrayLike, what: str) -> FloatArray:
    """Return a copy of what was asked as an array of whatever shape.

    Parameters
    ----------
    values : array, none and NaN both mean that a number is missing
    what : str, what it is, for the message
    """
    try:
        if np.iscomplexobj(values):  # an array of them would lose its imaginary part with no more than a warning
            raise TypeError("complex numbers")
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{what} must be numbers, in rows of one length ({error}).") from error


def pose_numbers(pose: ArrayLike, *, orientation: bool) -> FloatArray:
    """Return a copy of one pose as `(7,)`, or `(3,)` where a position-only model was given no more.

    Only the length is looked at; what the numbers are is looked at where they are used, see :func:`bad_query`.

    Parameters
    ----------
    pose : (7,) or (3,) array, m and unit quaternion wxyz
    orientation : bool, whether the model corrects orientations
    """
    values = numbers(pose, "a pose")
    if values.shape != (POSE,) and (orientation or values.shape != (POSITION,)):
        checked_poses(values[None], orientation=orientation)
    return values


def twist_numbers(twist: ArrayLike | None) -> FloatArray:
    """Return a copy of a twist as `(6,)`: m/s, then rad/s; three numbers are a linear velocity, None is at rest.

    Parameters
    ----------
    twist : (6,) or (3,) array, or None, m/s and rad/s
    """
    if twist is None:
        return np.zeros(TWIST)
    values = numbers(twist, "a twist")
    if values.shape == (POSITION,):
        values = np.concatenate([values, np.zeros(TWIST - POSITION)])
    if values.shape != (TWIST,):
        raise DataError(f"a twist is 6 numbers (vx vy vz wx wy wz), got an array of shape {values.shape}.")
    return values


def bad_query(pose: FloatArray, twist: FloatArray) -> DataError:
    """Return what is wrong with a query of the right lengths that cannot be answered.

    Parameters
    ----------
    pose : (7,) or (3,) array, m and quaternion wxyz
    twist : (6,) array, m/s and rad/s
    """
    if not np.isfinite(twist).all():
        return DataError(
            "the twist holds a number that is not finite.", hint="Leave the twist out where it is not known."
        )
    if (np.abs(twist) > LARGEST).any():
        return DataError(f"the twist holds {np.abs(twist).max():.3g}.", hint="Twists are m/s and rad/s.")
    try:
        checked_poses(pose[None], orientation=len(pose) == POSE)
    except DataError as error:
        return error
    return DataError("the pose cannot be mapped.")


def checked_poses(poses: ArrayLike, *, orientation: bool) -> FloatArray:
    """Return poses as `(n, 7)` with normalised quaternions, or `(n, 3)` for a position-only model.

    A position-only model takes poses with an orientation too, and keeps the orientation for the caller.

    Parameters
    ----------
    poses : (n, 7) or (n, 3) array, m and unit quaternions wxyz
    orientation : bool, whether the model corrects orientations
    """
    values = numbers(poses, "poses")
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
    if (np.abs(values[:, :POSITION]) > LARGEST).any():
        raise DataError(
            f"the pose lies {np.abs(values[:, :POSITION]).max():.3g} m from the origin.", hint="Positions are metres."
        )
    if len(values) and values.shape[1] == POSE:
        norms = np.linalg.norm(values[:, POSITION:], axis=1)
        worst = int(np.argmax(np.abs(norms - 1)))
        if abs(norms[worst] - 1) > QUATERNION_TOLERANCE:
            raise DataError(
                f"quaternion {worst} has norm {norms[worst]:.6g}, not 1.",
                hint="The order is qw qx qy qz; normalise it first.",
            )
        values[:, POSITION:] /= norms[:, None]
    return values


def checked_times(times: ArrayLike, count: int, sessions: IntArray | None = None) -> FloatArray:
    """Return the times of a path as `(count,)`, s.

    Parameters
    ----------
    times : (count,) array, s
    count : int, number of poses, or of joints' samples
    sessions : (count,) int array, optional, each of which has a clock of its own
    """
    values = numbers(times, "times")
    if not count:
        raise DataError("a path holds at least one sample, got none.")
    if values.shape != (count,):
        raise DataError(f"a path of {count} samples needs {count} times, got an array of shape {values.shape}.")
    same = slice(None) if sessions is None else np.diff(sessions) == 0
    if not np.isfinite(values).all() or (np.diff(values)[same] <= 0).any():
        raise DataError("the times of a path must be finite and strictly increasing.", hint="Times are seconds.")
    return values
