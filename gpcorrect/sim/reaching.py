"""Straight reaches of the tool from pose to pose, and the joint paths that make them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import RemoteCentreArm
from gpcorrect.errors import DataError
from gpcorrect.sim.plan import minimum_jerk, trapezoid
from gpcorrect.types import FloatArray, IntArray

ATTEMPTS = 200  # draws of a whole set of targets before a workspace counts as out of reach; chosen by hand
WORKING_DEPTH = 0.13  # m from the remote centre: chosen by hand, the middle of the insertion of every arm here
DEPTH_GRID = 331  # a millimetre or less apart
CONTINUOUS = 0.5  # rad or m; a larger step between samples is another branch, not motion


@dataclass(frozen=True)
class Pace:
    """How fast the tool goes.

    Parameters
    ----------
    speed, acceleration : float, cruising speed and acceleration along the path, m/s and m/s^2
    turn_rate : float, largest turning rate of the tool, rad/s: a reach that turns far goes slower
    law : "trapezoid" or "minimum-jerk", constant speed between ramps, or bell-shaped with the speed as its mean
    pause : float, rest after each reach, s

    Raises
    ------
    DataError
        A speed, the acceleration or the turning rate is not above 0 and finite, or the rest not at least 0.
    """

    speed: float = 0.05
    acceleration: float = 0.5
    turn_rate: float = 1.5
    law: Literal["trapezoid", "minimum-jerk"] = "trapezoid"
    pause: float = 0.0

    def __post_init__(self) -> None:
        rates = (self.speed, self.acceleration, self.turn_rate)
        if not all(0 < rate < np.inf for rate in rates) or not 0 <= self.pause < np.inf:
            raise DataError(f"a pace has finite rates above 0 and a rest of at least 0 s, got {self}.")

    def progress(self, distance: float, turn: float, rate_hz: float) -> FloatArray:
        """Return the progress `(n,)` over a reach.

        Parameters
        ----------
        distance, turn : float, of the reach, m and rad
        rate_hz : float, samples a second
        """
        longest = max(distance, turn * self.speed / self.turn_rate)
        if self.law == "minimum-jerk":
            return minimum_jerk(longest / self.speed, rate_hz)
        return trapezoid(longest, self.speed, self.acceleration, rate_hz)


@dataclass(frozen=True, eq=False)
class Workspace:
    """A box of positions with a cone of orientations.

    Parameters
    ----------
    T_base_centre : (4, 4) array, the box's centre and axes, base frame
    size : (3,) array, full widths along its axes, m
    R_base_tool : (3, 3) array, middle orientation of the tool
    tilt : float, largest turn away from it, rad
    crowding : float
        1 spreads targets evenly; more draws them towards the middle (both parameters of a beta law).
    """

    T_base_centre: FloatArray
    size: FloatArray
    R_base_tool: FloatArray
    tilt: float
    crowding: float = 1.0

    def sample(self, arm: RemoteCentreArm, count: int, rng: np.random.Generator) -> FloatArray:
        """Return random tool poses `(count, 4, 4)` that the arm reaches within its limits.

        Parameters
        ----------
        arm : RemoteCentreArm
        count : int
        rng : numpy.random.Generator

        Raises
        ------
        DataError
            Hardly any pose of the workspace can be reached.
        """
        found: list[FloatArray] = []
        for _ in range(ATTEMPTS):
            T = self._draw(count, rng)
            found += list(T[arm.solutions(T).within_limits.any(axis=-1)])
            if len(found) >= count:
                return np.stack(found[:count])
        raise DataError(
            f"{arm.name} reaches hardly any pose of the workspace.", hint="Move or shrink it, or allow less tilt."
        )

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        place = (rng.beta(self.crowding, self.crowding, (count, 3)) - 0.5) * self.size
        axis = rng.standard_normal((count, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        turn = axis * (self.tilt * rng.uniform(0, 1, (count, 1)) ** (1 / 3))
        position = place @ self.T_base_centre[:3, :3].T + self.T_base_centre[:3, 3]
        return se3.pose(se3.matrix_from_rotvec(turn) @ self.R_base_tool, position)


@dataclass(frozen=True, eq=False)
class Tour:
    """A path of reaches one after the other.

    Parameters
    ----------
    T_base_tip : (n, 4, 4) array, desired tool poses at the log's rate
    trajectory : (n,) int array
        Number of the reach each sample belongs to; the rest after a reach is part of it.
    """

    T_base_tip: FloatArray
    trajectory: IntArray


def tour(stops: FloatArray, numbers: Sequence[int], paces: Sequence[Pace], rate_hz: float) -> Tour:
    """Go from stop to stop in straight lines, turning evenly.

    Parameters
    ----------
    stops : (k + 1, 4, 4) array, tool poses, base frame
    numbers : sequence of k int, trajectory numbers of the reaches
    paces : sequence of k Pace
    rate_hz : float, samples a second
    """
    poses, labels = [stops[:1]], [np.array([numbers[0]])]
    for start, goal, number, pace in zip(stops[:-1], stops[1:], numbers, paces, strict=True):
        turn = se3.rotvec_from_matrix(goal[:3, :3] @ start[:3, :3].T)
        shift = goal[:3, 3] - start[:3, 3]
        s = pace.progress(float(np.linalg.norm(shift)), float(np.linalg.norm(turn)), rate_hz)[1:, None]
        path = se3.pose(se3.matrix_from_rotvec(s * turn) @ start[:3, :3], start[:3, 3] + s * shift)  # up to the goal
        rest = round(pace.pause * rate_hz)
        poses += [path, np.repeat(goal[None], rest, axis=0)]
        labels += [np.full(len(path), number), np.full(rest, number)]
    return Tour(np.concatenate(poses), np.concatenate(labels))


def joint_tour(arm: RemoteCentreArm, path: Tour) -> FloatArray:
    """Return the joint path `(n, dof)` of a tour, all on one branch of the inverse kinematics: the one nearest to home.

    Parameters
    ----------
    arm : RemoteCentreArm
    path : Tour

    Raises
    ------
    DataError
        No branch keeps within the limits all the way.
    """
    found = arm.solutions(path.T_base_tip)
    steps = np.abs(np.diff(found.q, axis=0)).max(axis=(0, 2), initial=0.0)
    usable = np.flatnonzero(found.within_limits.all(axis=0) & (steps < CONTINUOUS))
    if not len(usable):
        return arm.follow(path.T_base_tip)
    spans = np.ptp(arm.limits, axis=1)
    distance = (np.abs(found.q[0, usable] - arm.home) / spans).sum(axis=1)
    return found.q[:, usable[np.argmin(distance)]]


def working_posture(arm: RemoteCentreArm) -> FloatArray:
    """Return joint values `(dof,)` of the arm at home, but with its wrist well inside: 13 cm from the remote centre.

    Parameters
    ----------
    arm : RemoteCentreArm
    """
    depths = np.linspace(arm.limits[2, 0], arm.limits[2, 1], DEPTH_GRID)
    postures = np.repeat(arm.home[None], DEPTH_GRID, axis=0)
    postures[:, 2] = depths
    reach = np.linalg.norm(arm.wrist(postures), axis=1)
    return np.array(postures[np.argmin(np.abs(reach - WORKING_DEPTH))])


def upright(gravity: FloatArray) -> FloatArray:
    """Return the axes `(3, 3)`, as columns, of a box whose third axis points up against gravity, in the base frame.

    Parameters
    ----------
    gravity : (3,) array, free fall in the base frame, m/s^2
    """
    up = -gravity / np.linalg.norm(gravity)
    across = np.eye(3)[np.argmin(np.abs(up))]
    first = np.cross(across, up)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up], axis=1)
