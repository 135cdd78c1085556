"""Motions to calibrate with: zig-zags, random sinusoids and random sweeps.

A zig-zag sweeps one block of the joint space in stripes along one, two or three joints at once (Peng et al., Efficient
Data-driven Joint-level Calibration of Cable-driven Surgical Robots, Eqs. (1)-(5)): the path along one joint is made
once in the normalised range, turned so that its stripes run along the wanted joints, and put back on the common centre.
Turning keeps the volume; the block's diagonal is the range itself, so no direction leaves it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

Direction = Literal["J1", "J2", "J3", "J1-J2", "J2-J3", "J1-J3", "J1-J2-J3"]
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
RAMP_SECONDS = 0.2  # to speed up and to slow down at each corner; chosen by hand
SIDE = 1.0 / np.sqrt(3.0)  # of a cube whose diagonal is 1
PUBLISHED_REACH = 0.09093521, 0.90824829  # of joint 1's range, before the study's files are stretched along it
SINES = 4  # of each joint; chosen by hand
NEAR_LIMIT = 0.2  # fraction of the range, from its ends, in which a sweep ends; chosen by hand
TURN_SECONDS = 1.0  # over which a turn is rounded off; chosen by hand


def direction_named(name: str) -> Direction:
    """Return the direction of that name; "J2-3" is short for "J2-J3".

    Parameters
    ----------
    name : str, such as "J1", "J2-J3" or "J2-3"

    Raises
    ------
    DataError
        There is none.
    """
    digits = [part.strip().upper().removeprefix("J") for part in name.split("-")]
    for direction in DIRECTIONS:
        if direction == "-".join(f"J{digit}" for digit in digits):
            return direction
    raise DataError(f"a zig-zag runs along one of {', '.join(DIRECTIONS)}; got {name!r}.")


def zigzag(direction: Direction, sparsity: int, limits: FloatArray, *, as_published: bool = False) -> FloatArray:
    """Return the corners `(m, 3)` of the zig-zag path; every direction has the same centre and volume.

    Parameters
    ----------
    direction : str, joints along which the stripes run
    sparsity : int, n of the sparsity 1/n: stripes lie 1/n of the block's side apart
    limits : (3, 2) array
        Lowest and highest position of each joint, rad or m. One joint moves within +-r / (2 sqrt 3) of the middle of
        its range r, two within +-sqrt 2 r / (2 sqrt 3), three within +-r / 2.
    as_published : bool
        Along J1-J2-J3, drive as the study's published way-point files do instead of as its Eq. (3) says: turned by 45
        degrees about joint 3's axis and then joint 1's, so that joint 1 moves more than the others, and stretched along
        joint 1 to its whole range. Corners differ by up to a quarter of the range. The study's files of the other
        directions agree with its equations.

    Raises
    ------
    DataError
        The sparsity is not a whole number from 1, or the limits are not three rising pairs.
    """
    if sparsity < 1:
        raise DataError(f"the sparsity 1/n needs a whole number n from 1, got {sparsity}.", hint="For example 4.")
    limits = np.asarray(limits, dtype=np.float64)
    if limits.shape != (3, 2) or not (np.isfinite(limits).all() and (np.diff(limits) > 0).all()):
        raise DataError(
            f"limits must be three pairs, each lowest then highest, got {limits.tolist()}.",
            hint="Write them as LOW:HIGH,LOW:HIGH,LOW:HIGH",
        )
    centre, reach = limits.mean(axis=1), np.ptp(limits, axis=1)
    block = SIDE * _stripes(sparsity)
    if as_published and direction == "J1-J2-J3":
        turned = block @ Rotation.from_euler("zx", [45.0, 45.0], degrees=True).as_matrix().T
        low, high = PUBLISHED_REACH
        turned[:, 0] = (turned[:, 0] + 0.5 - low) / (high - low) - 0.5
    else:
        turned = block @ _rotation_to(direction).T
    return np.asarray(centre + reach * turned)


def _rotation_to(direction: Direction) -> FloatArray:
    """Rotation `(3, 3)` that takes the first axis to the direction, and the stack of stripes along."""
    along = np.array([f"J{i}" in direction.split("-") for i in (1, 2, 3)], dtype=np.float64)
    first = along / np.linalg.norm(along)
    # The next axis lies in the plane of two of the joints, so that a double direction turns within its own plane.
    still = int(np.argmin(along)) if along.sum() < 3 else 2
    third = np.eye(3)[still] - first[still] * first
    third /= np.linalg.norm(third)
    return np.column_stack([first, np.cross(third, first), third])


def _stripes(sparsity: int) -> FloatArray:
    """Corners of stripes along the first axis of the unit cube about 0, row by row, layer by layer, without jumps."""
    marks = np.linspace(-0.5, 0.5, sparsity + 1)
    corners, end = [], 0.5
    for layer, z in enumerate(marks):
        for y in marks if layer % 2 == 0 else marks[::-1]:
            corners += [(-end, y, z), (end, y, z)]
            end = -end
    return np.array(corners)


@dataclass(frozen=True, eq=False)
class TimedPath:
    """Desired joints at a steady rate.

    Parameters
    ----------
    time : (n,) array, s from 0
    q : (n, dof) array, rad or m
    """

    time: FloatArray
    q: FloatArray

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1] - self.time[0])


def timed(corners: FloatArray, speed: FloatArray, rate_hz: float, ramp: float = RAMP_SECONDS) -> TimedPath:
    """Drive straight from corner to corner, the joint that needs longest at its speed limit, the others in step.

    Parameters
    ----------
    corners : (m, dof) array, rad or m
    speed : (dof,) array, highest speed of each joint, rad/s or m/s
    rate_hz : float, samples a second
    ramp : float, seconds of constant acceleration at both ends of each stretch

    Raises
    ------
    DataError
        A speed or the rate is not above 0, or there is no way to drive.
    """
    speed = np.asarray(speed, dtype=np.float64)
    if speed.shape != corners.shape[1:] or not ((speed > 0).all() and rate_hz > 0):
        raise DataError(f"speed limits must be {corners.shape[1]} numbers above 0, got {speed.tolist()}.")
    cruise = np.max(np.abs(np.diff(corners, axis=0)) / speed, axis=1)
    if not cruise.sum() > 0:
        raise DataError("the path has no length.", hint="Give at least two different corners.")
    starts = np.concatenate([[0.0], np.cumsum(np.where(cruise > 0, cruise + ramp, 0.0))])
    time = np.arange(int(np.ceil(starts[-1] * rate_hz)) + 1) / rate_hz
    piece = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(cruise) - 1)
    done = _progress(time - starts[piece], cruise[piece], ramp)
    return TimedPath(time, corners[piece] + done[:, None] * (corners[piece + 1] - corners[piece]))


def _progress(t: FloatArray, cruise: FloatArray, ramp: float) -> FloatArray:
    """Fraction of a stretch done at t: speed rises, stays at most 1 / cruise, and falls again within cruise + ramp."""
    total = cruise + ramp
    rise = np.minimum(ramp, total / 2)  # a stretch shorter than the ramp never cruises
    t = np.clip(t, 0.0, total)
    left = np.minimum(total - t, rise)
    risen = 0.5 * np.minimum(t, rise) ** 2 / rise
    cruised = np.clip(t, rise, total - rise) - rise
    fallen = 0.5 * (rise**2 - left**2) / rise
    return np.asarray((risen + cruised + fallen) / (total - rise))


def random_sinusoids(
    limits: FloatArray, speed: FloatArray, seconds: float, rate_hz: float, rng: np.random.Generator
) -> TimedPath:
    """Return sums of sinusoids of random periods and phases, inside the limits and below the speed limits.

    Parameters
    ----------
    limits : (dof, 2) array, rad or m
    speed : (dof,) array, highest speeds
    seconds, rate_hz : float, length and rate
    rng : numpy.random.Generator, of periods, phases and amplitudes
    """
    middle, half = limits.mean(axis=1), np.ptp(limits, axis=1) / 2
    if not (2 <= seconds * rate_hz < np.inf and (half > 0).all()):
        raise DataError("random sinusoids need a range for every joint, at least two samples and an end.")
    amplitude = rng.dirichlet(np.ones(SINES), len(half))
    pace = rng.uniform(0.3, 1.0, amplitude.shape)
    top = (amplitude * pace).sum(axis=1, keepdims=True) * half[:, None]
    omega = pace * speed[:, None] / top
    phase = rng.uniform(0.0, 2.0 * np.pi, amplitude.shape)
    time = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    waves = (amplitude * np.sin(omega * time[:, None, None] + phase)).sum(axis=2)
    return TimedPath(time, middle + half * waves)


def random_sweeps(
    limits: FloatArray, slow: FloatArray, fast: FloatArray, seconds: float, rate_hz: float, rng: np.random.Generator
) -> TimedPath:
    """Return joints that sweep to and fro, each for itself, to a new end near its limit at a new speed every time.

    As the random motion of the public RAVEN-II Python controller (Peng 2022, run_r2_random_joint_movement.py).

    Parameters
    ----------
    limits : (dof, 2) array, rad or m
    slow, fast : (dof,) arrays, lowest and highest speed of a sweep
    seconds, rate_hz : float, length and rate
    rng : numpy.random.Generator, of ends and speeds
    """
    if not (
        seconds * rate_hz >= 2 and (np.ptp(limits, axis=1) > 0).all() and (slow > 0).all() and (slow <= fast).all()
    ):
        raise DataError("random sweeps need a range and rising speeds above 0 for every joint, and two samples.")
    time = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    joints = [_sweeps(*parts, time, rng) for parts in zip(limits, slow, fast, strict=True)]
    return TimedPath(time, np.column_stack(joints))


def _sweeps(limits: FloatArray, slow: float, fast: float, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    low, high = limits
    upwards = bool(rng.integers(2))
    moments, ends = [-TURN_SECONDS], [rng.uniform(low, high)]
    while moments[-1] < time[-1] + TURN_SECONDS:
        drawn = rng.uniform(0.0, NEAR_LIMIT) * (high - low)
        ends.append(high - drawn if upwards else low + drawn)
        moments.append(moments[-1] + max(abs(ends[-1] - ends[-2]) / rng.uniform(slow, fast), 1e-9))
        upwards = not upwards
    # The mean over a moving window rounds the turns off, and is no faster and reaches no further than the sweeps.
    around = np.linspace(-0.5, 0.5, 21) * TURN_SECONDS
    return np.asarray(np.interp(time[:, None] + around, moments, ends).mean(axis=1))
