"""Motions beyond zig-zags: random sinusoids and random sweeps."""

from __future__ import annotations

import numpy as np

from gpcorrect.calibration.zigzags import TimedPath
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

SINES = 4  # of each joint; chosen by hand
NEAR_LIMIT = 0.2  # fraction of the range, from its ends, in which a sweep ends; chosen by hand
TURN_SECONDS = 1.0  # over which a turn is rounded off; chosen by hand


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
