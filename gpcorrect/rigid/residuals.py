"""What is left after the rigid part, as a vector the Gaussian process can learn, and back."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, PoseSignal

__all__ = ["apply_residual", "pose_residual"]


def pose_residual(reference: PoseSignal, command: PoseSignal) -> FloatArray:
    """Residuals `(n, 6)` that :func:`apply_residual` adds to `reference` to reach `command`.

    The first three are the difference of the positions (m, common frame), the last three the rotation vector
    of `R_command R_reference^T` (rad, common frame, length at most pi). The rotation is NaN where either side
    measures positions only, and every component of a missing sample is NaN.

    Raises
    ------
    DataError
        The two signals differ in length.
    """
    _check_same_length(len(reference), len(command))
    residual = np.full((len(reference), 6), np.nan)
    residual[:, :3] = command.position - reference.position
    if reference.quaternion is not None and command.quaternion is not None:
        rows = reference.finite & command.finite
        R_ref = se3.matrix_from_quaternion(reference.quaternion[rows])
        R_cmd = se3.matrix_from_quaternion(command.quaternion[rows])
        residual[rows, 3:] = se3.rotvec_from_matrix(R_cmd @ np.swapaxes(R_ref, -1, -2))
    return residual


def apply_residual(reference: PoseSignal, residual: FloatArray) -> PoseSignal:
    """Poses reached from `reference` by residuals `(n, 6)`: `p + r[:3]` and `exp(r[3:]) R`.

    Where the rotation part is NaN (nothing was learned of orientations) the orientation stays as it is.

    Raises
    ------
    DataError
        The residuals are not `(n, 6)` with a row a pose.
    """
    residual = np.asarray(residual, dtype=np.float64)
    if residual.shape != (len(reference), 6):
        raise DataError(f"residuals must have shape ({len(reference)}, 6), got {residual.shape}.")
    position = reference.position + residual[:, :3]
    if reference.quaternion is None:
        return PoseSignal(position)
    rows: BoolArray = reference.finite & np.isfinite(residual[:, 3:]).all(axis=1)
    quaternion = np.array(reference.quaternion)
    turn = se3.matrix_from_rotvec(residual[rows, 3:])
    quaternion[rows] = se3.quaternion_from_matrix(turn @ se3.matrix_from_quaternion(quaternion[rows]))
    return PoseSignal(position, quaternion)


def _check_same_length(n_reference: int, n_command: int) -> None:
    if n_reference != n_command:
        raise DataError(f"the two signals must have a row for each other, got {n_reference} and {n_command} samples.")
