"""How loud an outside sensor is, trajectory by trajectory: whether its noise grew, or is more than the model states.

Second differences over neighbouring samples leave white noise and hardly anything of what moves, so that effects of
the mean, known or not, say little here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Growth", "growth_of", "levels_of", "roughness", "stated_level"]

FEWEST = 60  # second differences of a trajectory
SIDE = 2  # trajectories on either side of a change
TRIM = 5.0  # robust standard deviations: what is farther out is a fault
NORM = np.sqrt(6.0)  # deviation of a second difference of unit white noise
SURE = 1e-3  # chance of a change in noise that does not change, shared by the channels
LEAST = 0.02  # of the logarithm of the level: a smaller change is none
BEYOND = 1.2  # times the stated level, in nearly every trajectory
NEARLY = 0.9


@dataclass(frozen=True)
class Growth:
    """Noise beyond what was there before, or beyond what is stated.

    Parameters
    ----------
    std : float
        Of the further noise, unit of the channel.
    std_ci95 : pair of float
        By the scatter of the trajectories.
    since, since_ci95 : float, pair of float
        Session time from which on it is there, s.
    nats : float
        Gain of log-likelihood of the trajectories' levels.
    chance : float
        Of a change at least as clear in noise that does not change.
    """

    std: float
    std_ci95: tuple[float, float]
    since: float
    since_ci95: tuple[float, float]
    nats: float
    chance: float


def levels_of(residual: FloatArray, trajectory: IntArray, rows: BoolArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Levels `(k,)` of white noise of the trajectories that have enough samples, their numbers, relative errors `(k,)`.

    Parameters
    ----------
    residual : (n,) array
        Single samples; NaN is missing.
    trajectory : (n,) int array
        Of each sample.
    rows : (n,) bool array
        Samples that may be looked at.
    """
    levels, numbers, errors = [], [], []
    for number in np.unique(trajectory[rows]):
        values = residual[rows & (trajectory == number)]
        second = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / NORM
        second = second[np.isfinite(second)]
        scale = float(np.median(np.abs(second))) / NORMAL_MAD if len(second) else 0.0
        kept = second[np.abs(second) < TRIM * scale]
        if len(kept) < FEWEST:
            continue
        levels.append(float(np.sqrt(np.mean(kept**2))))
        numbers.append(number)
        # neighbouring second differences share samples: their squares count 35 / 18 times less than independent ones
        errors.append(float(0.5 * np.std(kept**2) / np.mean(kept**2) * np.sqrt(35.0 / 18.0 / len(kept))))
    return np.array(levels), np.array(numbers, dtype=np.int64), np.array(errors)


def roughness(residual: FloatArray) -> float:
    """Root mean square of all second differences of single samples `(n,)`, as white noise would have it."""
    second = (residual[2:] - 2.0 * residual[1:-1] + residual[:-2]) / NORM
    return float(np.sqrt(np.nanmean(second**2))) if np.isfinite(second).any() else 0.0


def stated_level(noise: ChannelNoise, step: float) -> float:
    """Return the level that :func:`levels_of` gives noise as it is stated."""
    phi = np.exp(-step / noise.time_constant)
    slow = noise.slow**2 * (6.0 - 8.0 * phi + 2.0 * phi**2) / 6.0
    return float(np.sqrt(noise.white**2 + slow))


def growth_of(
    levels: FloatArray,
    errors: FloatArray,
    start: FloatArray,
    end: FloatArray,
    stated: float | None,
    channels: int,
) -> Growth | None:
    """Return by how much noise grew at some moment, or exceeds what is stated; None when neither is beyond doubt.

    Parameters
    ----------
    levels, errors : (k,) arrays
        Level of each trajectory, and its relative error.
    start, end : (k,) arrays
        Session time at which each begins and ends, s.
    stated : float or None
        Level as the model states it.
    channels : int
        That are looked at: each has its share of the chance of a false alarm.
    """
    grown = _change(np.log(levels), errors, start, end, channels) if len(levels) >= 2 * SIDE else None
    if grown is None and stated is not None and len(levels):
        return _excess(levels, errors, start, stated)
    return grown


def _change(height: FloatArray, errors: FloatArray, start: FloatArray, end: FloatArray, channels: int) -> Growth | None:
    order = np.argsort(start, kind="stable")
    height, start, end = height[order], start[order], end[order]
    splits = np.flatnonzero(np.diff(start) > 0) + 1
    splits = splits[(splits >= SIDE) & (splits <= len(height) - SIDE)]
    if len(splits) == 0:
        return None
    floor = float(np.median(errors))
    rises = [_rise(height[:at], height[at:], floor) for at in splits]
    best = int(np.argmax(rises))
    chance = min(1.0, len(splits) * float(student.sf(rises[best], len(height) - 2)))
    at = int(splits[best])
    before, after = height[:at], height[at:]
    if chance > SURE / channels or after.mean() - before.mean() < LEAST:
        return None
    spread = np.sqrt(max(_within(before, after), floor**2))
    low, high = _extra(before, after, spread)
    total = max(float(np.mean((height - height.mean()) ** 2)), floor**2)
    nats = 0.5 * len(height) * float(np.log(total / spread**2))
    std = _further(float(after.mean()), float(before.mean()))
    return Growth(std, (low, high), float(start[at]), (float(start[at - 1]), float(end[at])), nats, chance)


def _rise(before: FloatArray, after: FloatArray, floor: float) -> float:
    """Student's statistic of a rise; trajectories scatter at least as their samples do."""
    spread = np.sqrt(max(_within(before, after), floor**2) * (1.0 / len(before) + 1.0 / len(after)))
    return float((after.mean() - before.mean()) / spread)


def _within(before: FloatArray, after: FloatArray) -> float:
    left = ((before - before.mean()) ** 2).sum() + ((after - after.mean()) ** 2).sum()
    return float(left / (len(before) + len(after) - 2))


def _further(after: float, before: float) -> float:
    """Further standard deviation from the logarithms of two levels."""
    return float(np.sqrt(max(np.exp(2.0 * after) - np.exp(2.0 * before), 0.0)))


def _extra(before: FloatArray, after: FloatArray, spread: float) -> tuple[float, float]:
    """95 % interval of the further noise."""
    half = 1.96 * spread * np.hypot(1.0 / np.sqrt(len(after)), 1.0 / np.sqrt(len(before)))
    a, b = float(after.mean()), float(before.mean())
    return _further(a - half, b), _further(a + half, b)


def _excess(levels: FloatArray, errors: FloatArray, start: FloatArray, stated: float) -> Growth | None:
    """Return noise beyond the stated one, when nearly every trajectory has it."""
    if float(np.mean(levels > BEYOND * stated)) < NEARLY:
        return None
    height, floor = np.log(levels), float(np.median(errors))
    spread = max(float(height.std()), floor)
    half = 1.96 * spread / np.sqrt(len(height))
    middle, nominal = float(height.mean()), float(np.log(stated))
    nats = 0.5 * float((((height - nominal) / spread) ** 2 - ((height - middle) / spread) ** 2).sum())
    ends = _further(middle - half, nominal), _further(middle + half, nominal)
    return Growth(_further(middle, nominal), ends, 0.0, (0.0, float(start.min())), nats, 0.0)
