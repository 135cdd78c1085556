"""Planning with a learned correction: desired paths, what to command instead, and the first path sure enough of it.

Desired poses are in the frame that the planner sees the world in.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.sim.reaching import Pace, tour
from gpcorrect.types import BoolArray, FloatArray, frozen_array

PATH_RATE_HZ = 50.0  # chosen by hand: a pose a millimetre at 5 cm/s
Mode = Literal["full", "endpoints"]
Cause = Literal["out of domain", "cut", "position interval", "rotation interval"]
REST = 1e4  # s between two poses: so slow that both are at rest for any model


@dataclass(frozen=True, eq=False)
class DesiredPath:
    """Where the tool shall be, and when.

    Parameters
    ----------
    times : (n,) array, seconds, strictly increasing
    T : (n, 4, 4) array, desired tool poses, planner's frame

    Raises
    ------
    DataError
        There is no pose, not one a time, or a number is missing; or times do not increase.
    """

    times: FloatArray
    T: FloatArray

    def __post_init__(self) -> None:
        times, T = frozen_array(self.times), frozen_array(self.T)
        if times.ndim != 1 or T.shape != (len(times), 4, 4) or not len(times):
            raise DataError(f"a path needs one pose (4, 4) a time, got {T.shape} for times {times.shape}.")
        if not (np.isfinite(times).all() and np.isfinite(T).all()):
            raise DataError("a path needs finite times and poses, got some that are not.")
        if not (np.diff(times) > 0).all():
            raise DataError("the times of a path increase from pose to pose, these do not.", hint="Give seconds.")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "T", T)

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
        return np.asarray(self.T[-1])


def reach(stops: FloatArray, pace: Pace) -> DesiredPath:
    """Go from pose to pose in straight lines, at rest in each, turning evenly.

    Parameters
    ----------
    stops : (k + 1, 4, 4) array, start, stops and goal
    pace : Pace, speed, acceleration and rests

    Raises
    ------
    DataError
        There are not two poses at least, or a number is missing.
    """
    stops = np.asarray(stops, dtype=np.float64)
    if stops.ndim != 3 or stops.shape[1:] != (4, 4) or len(stops) < 2 or not np.isfinite(stops).all():
        raise DataError(f"a reach needs a start and a goal at least, finite poses (k + 1, 4, 4); got {stops.shape}.")
    count = len(stops) - 1
    path = tour(stops, range(count), [pace] * count, PATH_RATE_HZ)
    return DesiredPath(np.arange(len(path.T_base_tip)) / PATH_RATE_HZ, path.T_base_tip)


def circle(
    T_centre: FloatArray, radius: float, speed: float, rounds: float = 1.0, rate_hz: float = PATH_RATE_HZ
) -> DesiredPath:
    """Go round a centre in its x-y plane at constant speed, from the point on its x axis.

    Parameters
    ----------
    T_centre : (4, 4) array, pose of the centre; the tool keeps its orientation
    radius : float, m
    speed : float, m/s
    rounds : float, circles
    rate_hz : float, poses a second

    Raises
    ------
    DataError
        Radius, speed, rounds or rate are not above 0 and finite; or the centre is no pose.
    """
    sizes = (radius, speed, rounds, rate_hz)
    if not all(0 < size < np.inf for size in sizes):
        raise DataError(f"a circle needs radius, speed, rounds and rate above 0 and finite, got {sizes}.")
    T_centre = np.asarray(T_centre, dtype=np.float64)
    if T_centre.shape != (4, 4) or not np.isfinite(T_centre).all():
        raise DataError(f"the centre of a circle is a finite pose (4, 4), got {T_centre.tolist()}.")
    seconds = 2 * np.pi * radius * rounds / speed
    times = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    angle = 2 * np.pi * rounds * times / max(float(times[-1]), 1e-9)
    offset = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    T = np.repeat(T_centre[None], len(times), axis=0)
    T[:, :3, 3] += offset @ T_centre[:3, :3].T
    return DesiredPath(times, T)


class Corrects(Protocol):
    """A correction, served or in process: a `CommandCorrector` or a `CorrectionClient`."""

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Any:
        """Return what to command instead of a path: a `Correction`, or the service's `Reply` around one.

        Parameters
        ----------
        poses : (n, 7) array, positions (m) and quaternions wxyz
        times : (n,) array, seconds
        """


@dataclass(frozen=True, eq=False)
class CommandPath:
    """A path to command, and how sure its correction is.

    Parameters
    ----------
    times : (n,) array, seconds
    T : (n, 4, 4) array, tool poses to command, base frame
    interval95 : (m, 6) array, half widths at the poses that were asked for: all of them, or the two ends; m then rad
    in_domain : (m,) array, whether each lies near training data
    status : tuple of m str, of each, as `Correction` has it
    """

    times: FloatArray
    T: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    status: tuple[str, ...]


def corrected(corrector: Corrects, path: DesiredPath, mode: Mode = "full") -> CommandPath:
    """Return what to command so that the tool follows a path, or at least begins and ends where the path does.

    Parameters
    ----------
    corrector : Corrects
    path : DesiredPath, in the frame that the model was trained in
    mode : "full" or "endpoints"
        Correct every pose with its velocity; or the two ends, at rest, with the path's own course between.

    Raises
    ------
    DataError
        The model does not correct orientations, or there is no such mode.
    """
    if mode not in get_args(Mode):
        raise DataError(f"a path is corrected in full or at its endpoints, got {mode!r}.")
    ends = [0, len(path.times) - 1]
    if mode == "full":
        answer = corrector.correct_path(path.poses, path.times)
    else:
        answer = corrector.correct_path(path.poses[ends], np.array([0.0, REST]))
    if answer.position is None or answer.quaternion is None:
        raise DataError("this model corrects positions only.", hint="Plan with a model that was fitted to full poses.")
    T = se3.from_parts(answer.position, answer.quaternion)
    command = T if mode == "full" else _between(path, T)
    return CommandPath(path.times, command, answer.interval95, answer.in_domain, tuple(answer.status))


def _between(path: DesiredPath, ends: FloatArray) -> FloatArray:
    """Move the path rigidly with its first pose, and remove the miss of its last one in proportion to the way gone."""
    moved = se3.compose(ends[0], se3.invert(path.T[0]), path.T)
    miss = se3.compose(se3.invert(moved[-1]), ends[1])
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.T[:, :3, 3], axis=0), axis=1))])
    if gone[-1] < 1e-9:  # nothing moves: in proportion to time
        gone = path.times - path.times[0]
    return se3.compose(moved, se3.exp((gone / max(float(gone[-1]), 1e-12))[:, None] * se3.log(miss)))


@dataclass(frozen=True)
class Doubt:
    """Why a path is not trusted.

    Parameters
    ----------
    cause : str, what went beyond its margin
    value, allowed : float, how far, and how far it may: m, rad, or the fraction of poses out of domain
    """

    cause: Cause
    value: float
    allowed: float

    def __str__(self) -> str:
        match self.cause:
            case "out of domain":
                return f"{100 * self.value:.0f} % of the poses are out of domain"
            case "cut":
                return "the command at the goal is not the whole correction: its status is not OK"
            case "position interval":
                return f"the tool's place is known to {1e3 * self.value:.1f} mm, {1e3 * self.allowed:.1f} mm are needed"
            case "rotation interval":
                known, needed = np.rad2deg([self.value, self.allowed])
                return f"the tool's turn is known to {known:.1f} deg, {needed:.1f} deg are needed"


@dataclass(frozen=True)
class Margins:
    """What must hold where the tool arrives, where a mistake matters; on the way there only the domain is checked.

    The defaults were chosen by hand for the debridement task: a gripper there catches within 5 mm and 25 degrees.

    Parameters
    ----------
    position : float, largest half width of the 95 % interval along any axis at the goal, m
    rotation : float, the same for the rotation, rad
    outside : float, largest fraction of a path's poses that may lie out of domain; the goal itself never may
    """

    position: float = 0.004
    rotation: float = np.deg2rad(12.0)
    outside: float = 0.5

    def __post_init__(self) -> None:
        if not (self.position > 0 and self.rotation > 0 and 0 <= self.outside <= 1):
            raise DataError(f"margins are lengths and angles above 0, and a fraction from 0 to 1; got {self}.")

    def doubt(self, command: CommandPath) -> Doubt | None:
        """Return the first reason not to trust a command, or None.

        Parameters
        ----------
        command : CommandPath
        """
        outside = 1.0 - float(np.mean(command.in_domain))
        if outside > self.outside or not command.in_domain[-1]:
            return Doubt("out of domain", outside, self.outside)
        if command.status[-1] != "OK":  # its interval is of the correction that was not made
            return Doubt("cut", 1.0, 0.0)
        # NaN marks what was not learned, and so is not known at all.
        half_widths = np.where(np.isnan(command.interval95[-1]), np.inf, command.interval95[-1])
        position, rotation = float(half_widths[:3].max()), float(half_widths[3:].max())
        if position > self.position:
            return Doubt("position interval", position, self.position)
        if rotation > self.rotation:
            return Doubt("rotation interval", rotation, self.rotation)
        return None


@dataclass(frozen=True, eq=False)
class Planned:
    """A path that was chosen.

    Parameters
    ----------
    number : int, which of the paths, from 0
    path : DesiredPath
    command : CommandPath
    doubts : tuple of Doubt
        Why the paths before it were left, and at the end why this one is doubtful too, where none was trusted.
    trusted : bool, whether its correction is within the margins
    """

    number: int
    path: DesiredPath
    command: CommandPath
    doubts: tuple[Doubt, ...]
    trusted: bool


def first_trusted(corrector: Corrects, paths: Iterable[DesiredPath], margins: Margins, mode: Mode = "full") -> Planned:
    """Return the first path that can be trusted; when none can, the last one, with `trusted` False.

    Parameters
    ----------
    corrector : Corrects
    paths : iterable of DesiredPath, several ways to do the same, best first; later ones are only corrected when needed
    margins : Margins
    mode : "full" or "endpoints", see :func:`corrected`

    Raises
    ------
    DataError
        There is no path.
    """
    doubts: tuple[Doubt, ...] = ()
    last: Planned | None = None
    for number, path in enumerate(paths):
        command = corrected(corrector, path, mode)
        doubt = margins.doubt(command)
        doubts = doubts if doubt is None else (*doubts, doubt)
        last = Planned(number, path, command, doubts, trusted=doubt is None)
        if last.trusted:
            break
    if last is None:
        raise DataError("there is no path to choose from.")
    return last
