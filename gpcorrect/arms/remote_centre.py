"""An arm that pivots about a remote centre of motion, and its closed-form inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.arms.arm import Arm
from gpcorrect.arms.rcm import RcmInverse
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

LIMIT_ROUNDING = 1e-9  # rad or m beyond a limit that count as on it: far above rounding, far below a micrometre


@dataclass(frozen=True, eq=False)
class Solutions:
    """Closed-form inverse kinematics of one or many poses.

    Parameters
    ----------
    q : (..., 8, dof) array
        Joint values by branch, NaN where the branch does not exist; each angle is the turn nearest to the
        middle of its limits.
    exists : (..., 8) bool array
        Whether the branch reaches the pose.
    within_limits : (..., 8) bool array
        Whether it also keeps every joint limit.
    """

    q: FloatArray
    exists: BoolArray
    within_limits: BoolArray


@dataclass(frozen=True, eq=False, kw_only=True)
class RemoteCentreArm(Arm):
    """A surgical arm, RRPRRR, that pivots about a remote centre of motion.

    Parameters
    ----------
    wrist_link : int
        Link (from 1) whose frame sits in the wrist point, where the pitch axis crosses the shaft.

    Raises
    ------
    DataError
        The chain's axes do not meet in a remote centre, or an array does not fit the chain.
    """

    wrist_link: int
    _inverse: RcmInverse = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "_inverse", RcmInverse.of(self.chain, self.wrist_link))

    def wrist(self, q: ArrayLike) -> FloatArray:
        """Return the wrist points (..., 3), m; the first three joints alone move them.

        Parameters
        ----------
        q : (..., dof) array
            Joint values, rad and m.
        """
        return self.chain.frames(q)[..., self.wrist_link - 1, :3, 3]

    def solutions(self, T: ArrayLike) -> Solutions:
        """Return all closed-form solutions for tip poses, in and out of limits.

        Parameters
        ----------
        T : (..., 4, 4) array
            Tip poses in the base frame.

        Raises
        ------
        DataError
            `T` does not hold poses.
        """
        poses = np.asarray(T, dtype=np.float64)
        if poses.shape[-2:] != (4, 4):
            raise DataError(f"poses must have shape (..., 4, 4), got {poses.shape}.")
        q = self._nearest_turns(self._inverse.solve(poses), self.limits.mean(axis=1))
        exists: BoolArray = np.asarray(np.isfinite(q).all(axis=-1))
        return Solutions(q, exists, exists & self.chain.within_limits(q, LIMIT_ROUNDING))

    def inverse(self, T: ArrayLike, within_limits: bool = True) -> FloatArray:
        """Joint values (k, dof) that reach one tip pose `T` (4, 4); k is 0 when there are none.

        Parameters
        ----------
        T : (4, 4) array
            Tip pose in the base frame.
        within_limits : bool
            Return the solutions that keep every limit, with all full turns that do; otherwise every solution
            once.

        Raises
        ------
        DataError
            `T` is not one pose.
        """
        pose = np.asarray(T, dtype=np.float64)
        if pose.shape != (4, 4):
            raise DataError(f"one pose (4, 4) is expected, got {pose.shape}; see solutions() for many.")
        found = self.solutions(pose)
        q = found.q[found.exists]
        return self._all_turns(q) if within_limits else q

    def follow(self, T: ArrayLike, start: ArrayLike | None = None) -> FloatArray:
        """Joint path (n, dof) within limits along tip poses `T` (n, 4, 4): always the nearest solution.

        Distances are measured in parts of each joint's range.

        Parameters
        ----------
        T : (n, 4, 4) array
            Tip poses in the base frame.
        start : (dof,) array, optional
            Joint values to begin near; home by default.

        Raises
        ------
        DataError
            A pose cannot be reached within limits; the message names it.
        """
        found = self.solutions(T)
        near = self.home if start is None else self.chain.joint_values(start)
        path, spans = np.empty((len(found.q), self.dof)), np.ptp(self.limits, axis=1)
        for i, branches in enumerate(found.q):
            options = self._all_turns(branches[found.exists[i]])
            if not len(options):
                raise DataError(
                    f"pose {i} cannot be reached within the limits of {self.name}.",
                    hint="Move the path into the workspace.",
                )
            near = path[i] = options[np.argmin((((options - near) / spans) ** 2).sum(axis=1))]
        return path

    def _nearest_turns(self, q: FloatArray, near: FloatArray) -> FloatArray:
        """Angles moved by full turns to lie nearest to `near`; prismatic joints stay."""
        turns = np.round((near - q) / (2 * np.pi))
        return q + np.where(self.chain.revolute, 2 * np.pi * turns, 0.0)

    def _all_turns(self, q: FloatArray) -> FloatArray:
        """Every variant of `q` (k, dof) by one full turn of a revolute joint that keeps the limits."""
        roomy = self.chain.revolute & (np.ptp(self.limits, axis=1) > 2 * np.pi)
        choices = [(-1, 0, 1) if room else (0,) for room in roomy]
        shifts = 2 * np.pi * np.array(list(product(*choices)))
        variants = (q[:, None] + shifts).reshape(-1, self.dof)
        return variants[self.chain.within_limits(variants, LIMIT_ROUNDING)]
