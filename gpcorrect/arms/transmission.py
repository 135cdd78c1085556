"""Cables and gears between motors and joints, as far as they are linear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["Transmission"]


@dataclass(frozen=True, eq=False)
class Transmission:
    """Motors turn by `matrix` times the joint motion: ratios on the diagonal, cable coupling below it.

    Parameters
    ----------
    matrix : (dof, dof) array
        Motor rad for each joint rad or m.

    Raises
    ------
    DataError
        The matrix is not square or cannot be inverted.
    """

    matrix: FloatArray

    def __post_init__(self) -> None:
        matrix = frozen_array(self.matrix)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            raise DataError(f"a transmission matrix must be square, got {matrix.shape}.")
        if np.linalg.matrix_rank(matrix) < len(matrix):
            raise DataError("the transmission matrix is singular: some joint motion moves no motor.")
        object.__setattr__(self, "matrix", matrix)

    @property
    def ratios(self) -> FloatArray:
        """(dof,) motor rad for each joint rad or m, coupling left aside."""
        return np.diagonal(self.matrix)

    def motor_from_joint(self, q: ArrayLike) -> FloatArray:
        """Motor angles (..., dof), rad, of joint values `q` (..., dof), rad and m."""
        return np.asarray(q, dtype=np.float64) @ self.matrix.T

    def joint_from_motor(self, motor: ArrayLike) -> FloatArray:
        """Joint values (..., dof), rad and m, of motor angles (..., dof), rad."""
        angles = np.asarray(motor, dtype=np.float64)
        return np.asarray(np.linalg.solve(self.matrix, angles[..., None])[..., 0])

    def joint_torque(self, motor_torque: ArrayLike) -> FloatArray:
        """Joint torques and forces (..., dof) that lossless motors' torques (..., dof), N m, exert."""
        return np.asarray(motor_torque, dtype=np.float64) @ self.matrix

    def motor_torque(self, joint_torque: ArrayLike) -> FloatArray:
        """Motor torques (..., dof), N m, that exert joint torques and forces (..., dof) without loss."""
        loads = np.asarray(joint_torque, dtype=np.float64)
        return np.asarray(np.linalg.solve(self.matrix.T, loads[..., None])[..., 0])
