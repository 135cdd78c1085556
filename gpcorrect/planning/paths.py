"""Desired paths: poses and their times, in the frame that the planner sees the world in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.sim.reaching import Pace, tour
from gpcorrect.types import FloatArray, frozen_array

PATH_RATE_HZ = 50.0  # chosen by hand: a pose a millimetre at 5 cm/s


@dataclass(frozen=True, eq=False)
class DesiredPath:
    """Where the tool shall be, and when.

    Parameters
    ----------
    times : (n,) array
        Seconds, strictly increasing.
    T : (n, 4, 4) array
        Desired tool poses, planner's frame.
    """

    times: FloatArray
    T: FloatArray

    def __post_init__(self) -> None:
        if self.T.shape != (len(self.times), 4, 4) or not len(self.times):
            raise DataError(f"a path needs one pose (4, 4) a time, got {self.T.shape} for {len(self.times)} times.")
        object.__setattr__(self, "times", frozen_array(self.times))
        object.__setattr__(self, "T", frozen_array(self.T))

    @property
    def poses(self) -> FloatArray:
        """(n, 7) positions (m) and quaternions wxyz."""
        return np.hstack(se3.to_parts(self.T))

    @property
    def duration(self) -> float:
        """Seconds from first to last pose."""
        return float(self.times[-1] - self.times[0])

    @property
    def goal(self) -> FloatArray:
        """(4, 4) last pose."""
        last: FloatArray = self.T[-1]
        return last


def reach(stops: FloatArray, pace: Pace) -> DesiredPath:
    """Go from pose to pose in straight lines, at rest in each, turning evenly.

    Parameters
    ----------
    stops : (k + 1, 4, 4) array
        Start, stops and goal.
    pace : Pace
        Speed, acceleration and rests.
    """
    count = len(stops) - 1
    path = tour(stops, range(count), [pace] * count, PATH_RATE_HZ)
    return DesiredPath(np.arange(len(path.T_base_tip)) / PATH_RATE_HZ, path.T_base_tip)


def circle(
    T_centre: FloatArray, radius: float, speed: float, rounds: float = 1.0, rate_hz: float = PATH_RATE_HZ
) -> DesiredPath:
    """Go round a centre in its x-y plane at constant speed, from the point on its x axis.

    Parameters
    ----------
    T_centre : (4, 4) array
        Pose of the centre; the tool keeps its orientation.
    radius : float
        m.
    speed : float
        m/s.
    rounds : float
        Circles.
    rate_hz : float
        Poses a second.

    Raises
    ------
    DataError
        Radius, speed or rounds are not above 0.
    """
    if not (radius > 0 and speed > 0 and rounds > 0):
        raise DataError(f"a circle needs radius, speed and rounds above 0, got {radius}, {speed} and {rounds}.")
    seconds = 2 * np.pi * radius * rounds / speed
    times = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    angle = 2 * np.pi * rounds * times / max(float(times[-1]), 1e-9)
    offset = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    T = np.repeat(T_centre[None], len(times), axis=0)
    T[:, :3, 3] += offset @ T_centre[:3, :3].T
    return DesiredPath(times, T)
