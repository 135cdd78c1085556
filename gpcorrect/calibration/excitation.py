"""Motions beyond zig-zags: random sinusoids, and runs that separate effects which look alike in a zig-zag.

A zig-zag at constant speed cannot distinguish friction from delay, play from sag, or stretch from a gain; a speed
ladder, holds and several amplitudes can.
"""

from __future__ import annotations

import numpy as np

from gpcorrect.calibration.zigzags import TimedPath, timed
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["amplitude_ladder", "holds", "random_sinusoids", "random_sweeps", "speed_ladder"]

SINES = 4  # of each joint; chosen by hand
LADDER = (0.1, 0.25, 0.5, 1.0)  # fractions of the highest speed; chosen by hand
NEAR_LIMIT = 0.2  # fraction of the range, from its ends, in which a sweep ends; chosen by hand
TURN_SECONDS = 1.0  # over which a turn is rounded off; chosen by hand
AMPLITUDES = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # fractions of the range; chosen by hand


def random_sinusoids(
    limits: FloatArray, speed: FloatArray, seconds: float, rate_hz: float, rng: np.random.Generator
) -> TimedPath:
    """Return sums of sinusoids of random periods and phases, inside the limits and below the speed limits.

    Parameters
    ----------
    limits : (dof, 2) array
        rad or m.
    speed : (dof,) array
        Highest speeds.
    seconds, rate_hz : float
        Length and rate.
    rng : numpy.random.Generator
        Of periods, phases and amplitudes.
    """
    middle, half = limits.mean(axis=1), np.ptp(limits, axis=1) / 2
    if not (seconds * rate_hz >= 2 and (half > 0).all()):
        raise DataError("random sinusoids need a range for every joint and at least two samples.")
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
    limits : (dof, 2) array
        rad or m.
    slow, fast : (dof,) arrays
        Lowest and highest speed of a sweep.
    seconds, rate_hz : float
        Length and rate.
    rng : numpy.random.Generator
        Of ends and speeds.
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
    rounded: FloatArray = np.interp(time[:, None] + around, moments, ends).mean(axis=1)
    return rounded


def speed_ladder(limits: FloatArray, speed: FloatArray, rate_hz: float) -> TimedPath:
    """Each joint alone, to and fro at a ladder of speeds: friction, damping and delay grow differently.

    Parameters
    ----------
    limits : (dof, 2) array
        Range of each joint, rad or m.
    speed : (dof,) array
        Highest speeds, rad/s or m/s.
    rate_hz : float
        Samples a second.
    """
    paths = [
        timed(_to_and_fro(limits, joint, 1.0), fraction * speed, rate_hz)
        for joint in range(len(limits))
        for fraction in LADDER
    ]
    return _joined(paths, rate_hz)


def amplitude_ladder(limits: FloatArray, speed: FloatArray, rate_hz: float) -> TimedPath:
    """Each joint alone, to and fro over growing amplitudes: a play takes the same from all, a gain in proportion.

    Parameters
    ----------
    limits : (dof, 2) array
        Range of each joint, rad or m.
    speed : (dof,) array
        Speeds, rad/s or m/s.
    rate_hz : float
        Samples a second.
    """
    paths = [
        timed(_to_and_fro(limits, joint, fraction), speed, rate_hz)
        for joint in range(len(limits))
        for fraction in AMPLITUDES
    ]
    return _joined(paths, rate_hz)


def holds(
    limits: FloatArray,
    speed: FloatArray,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    count: int = 10,
    rest: float = 5.0,
) -> TimedPath:
    """Random poses, each held for `rest` seconds: creep and sag go on when nothing moves.

    Parameters
    ----------
    limits : (dof, 2) array
        Range of each joint, rad or m.
    speed : (dof,) array
        Speeds between poses, rad/s or m/s.
    rate_hz : float
        Samples a second.
    rng : numpy.random.Generator
        Draws the poses.
    count : int
        Number of poses.
    rest : float
        Time at each pose, s.
    """
    corners = np.vstack([limits.mean(axis=1), rng.uniform(limits[:, 0], limits[:, 1], (count, len(limits)))])
    still = round(rest * rate_hz)
    paths = []
    for k in range(count):
        path = timed(corners[k : k + 2], speed, rate_hz).q
        paths.append(TimedPath(np.zeros(0), np.vstack([path, np.repeat(corners[k + 1 : k + 2], still, axis=0)])))
    return _joined(paths, rate_hz)


def _to_and_fro(limits: FloatArray, joint: int, fraction: float) -> FloatArray:
    """From the middle up, down and back, a fraction of one joint's range."""
    corners = np.repeat(limits.mean(axis=1)[None], 4, axis=0)
    corners[1, joint] += fraction * np.ptp(limits[joint]) / 2
    corners[2, joint] -= fraction * np.ptp(limits[joint]) / 2
    return corners


def _joined(paths: list[TimedPath], rate_hz: float) -> TimedPath:
    q = np.concatenate([path.q for path in paths])
    return TimedPath(np.arange(len(q)) / rate_hz, q)
