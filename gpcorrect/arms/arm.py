"""An arm: its chain, its numerical inverse, its cable drive, and the numbers that come with the machine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.arms.chain import Chain
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

STANDARD_GRAVITY = 9.80665  # m/s^2 (CGPM 1901)


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link: its mass and where that mass sits.

    Parameters
    ----------
    mass : float, kg
    com : (3,) array, centre of mass in the link's own frame, m
    inertia : (3, 3) array, about the centre of mass, along the link frame's axes, kg m^2; none where it is not known

    Raises
    ------
    DataError
        The mass is negative, or the centre is not three finite numbers.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "com", frozen_array(self.com))
        object.__setattr__(self, "inertia", frozen_array(self.inertia))
        if not self.mass >= 0 or self.com.shape != (3,) or not np.isfinite(self.com).all():
            raise DataError(f"a link is a mass >= 0 kg and a centre (3,) m, got {self.mass} and {self.com}.")


@dataclass(frozen=True, eq=False)
class Transmission:
    """Motors turn by `matrix` times the joint motion: ratios on the diagonal, cable coupling below it.

    Parameters
    ----------
    matrix : (dof, dof) array, motor rad for each joint rad or m

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
        """Return motor angles (..., dof), rad.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        return np.asarray(q, dtype=np.float64) @ self.matrix.T

    def motor_torque(self, joint_torque: ArrayLike) -> FloatArray:
        """Return the torques (..., dof), N m, of lossless motors that exert these on the joints.

        Parameters
        ----------
        joint_torque : (..., dof) array, N m and N
        """
        loads = np.asarray(joint_torque, dtype=np.float64)
        return np.asarray(np.linalg.solve(self.matrix.T, loads[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm.

    Parameters
    ----------
    name : str, its name in messages and logs
    chain : Chain, kinematics with limits
    home : (dof,) array, rest position, rad and m
    gravity : (3,) array, acceleration of free fall in the base frame of a normally mounted arm, m/s^2
    links : tuple of Link, known masses of links 1, 2, ...; empty where none are published
    velocity_limits : (dof,) array or None, largest joint speeds, rad/s and m/s
    transmission : Transmission or None, nominal cable drive

    Raises
    ------
    DataError
        An array does not fit the chain.
    """

    name: str
    chain: Chain
    home: FloatArray
    gravity: FloatArray
    links: tuple[Link, ...] = ()
    velocity_limits: FloatArray | None = None
    transmission: Transmission | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "home", frozen_array(self.chain.joint_values(self.home)))
        object.__setattr__(self, "gravity", frozen_array(self.gravity))
        if self.velocity_limits is not None:
            object.__setattr__(self, "velocity_limits", frozen_array(self.chain.joint_values(self.velocity_limits)))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return self.chain.dof

    @property
    def joint_types(self) -> str:
        """Joint kinds in one word."""
        return self.chain.joint_types

    @property
    def limits(self) -> FloatArray:
        """(dof, 2) lower and upper joint limits, rad or m."""
        return self.chain.limits

    def forward(self, q: ArrayLike) -> FloatArray:
        """Return the tip poses T_base_tip (..., 4, 4).

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        return self.chain.forward(q)

    def follow(self, T: ArrayLike, start: ArrayLike | None = None) -> FloatArray:
        """Joint path (n, dof) within limits along tip poses `T` (n, 4, 4), near to where it starts.

        Found numerically, each pose from the posture before it; arms with a closed form choose the nearest of all
        solutions.

        Parameters
        ----------
        T : (n, 4, 4) array, tip poses in the base frame
        start : (dof,) array, optional, joint values to begin near; home by default

        Raises
        ------
        DataError
            A pose cannot be reached within limits; the message names it.
        """
        near = self.home if start is None else self.chain.joint_values(start)
        poses = np.asarray(T, dtype=np.float64)
        path = np.empty((len(poses), self.dof))
        for i, pose in enumerate(poses):
            try:
                near = path[i] = self.chain.inverse(pose, near)
            except DataError as error:
                raise DataError(f"pose {i}: {error}", hint="Move the path into the workspace.") from error
        return path
