"""Noise that grows with speed: a test on what neighbouring samples differ by, and on nothing that is smooth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.settings import SENSORS, TESTS
from gpcorrect.types import BoolArray, FloatArray, IntArray

# Times the mean product of neighbouring second differences (1, -2, 1 over the root of 6) is the variance of white
# noise: their weights share -4 of 6. Of what is smooth the product is positive, so that an unexplained motion, which
# grows with speed as well, counts against noise and never for it.
NEIGHBOURS = -1.5
MOVING = 0.05  # of a joint's root mean square speed, from which on it counts as moving: below it creeps
REWEIGHTED = 4  # rounds of the regression: weights come from the line of the round before, and stand still after three


def second_differences(values: FloatArray) -> FloatArray:
    """Return second differences `(n - 2, ...)` over the root of 6: of white noise, they have its standard deviation.

    Parameters
    ----------
    values : (n, ...) array, single samples in their order
    """
    second: FloatArray = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / np.sqrt(6.0)
    return second


@dataclass(frozen=True)
class SpeedGrowth:
    """Variance of noise that goes with the square of the speed."""

    seconds: float  # root of its slope: the spread of the instants, s
    seconds_ci95: tuple[float, float]  # by the scatter of stretches
    level: float  # noise at rest, rad or m
    nats: float  # half the square of the slope's standard score


def speed_growth(
    residual: FloatArray,
    speeds: FloatArray,
    column: int,
    trajectory: IntArray,
    rows: BoolArray,
    *,
    stated: float,
    rounding: float,
    channels: int,
) -> SpeedGrowth | None:
    """Return how noise grows with speed; None where that is not beyond doubt.

    Within each trajectory the variance is regressed on the squared speed, so that a level that changes from one to the
    next says nothing; and it must stand beside each other law that noise of a moving arm may follow: the arm's pace,
    another joint's speed, or any motion. Samples count by the variance they are expected to have, and stretches of
    samples are asked whether they agree: Student's test of their scores.

    Parameters
    ----------
    residual : (n,) array, single samples, rad or m; NaN is missing
    speeds : (n, k) array, of all joints, rad/s or m/s
    column : int, of the joint
    trajectory : (n,) int array, of each sample
    rows : (n,) bool array, samples that may be looked at
    stated : float, standard deviation of the instants that the model knows of, s: growth is what goes beyond it
    rounding : float
        Standard deviation of the error of the motor's encoder: by rounding a prediction is noisier where it moves.
    channels : int, that are looked at: each has its part of the chance of a false alarm
    """
    own = speeds[:, [column]] ** 2
    line = _line(*_samples(residual, own, trajectory, rows, stated))
    if line is None or line.chance > SENSORS.chance / channels:
        return None
    if 0.5 * np.log1p(line.grown / line.level**2) < SENSORS.least_change or line.grown < SENSORS.coarser * rounding**2:
        return None
    for others in _other_laws(np.abs(speeds), column):
        beside = _line(*_samples(residual, np.column_stack([own, others]), trajectory, rows, stated))
        if beside is None or beside.chance > 1.0 - TESTS.level:
            return None
    low, high = np.sqrt(np.maximum(line.ci95, 0.0))
    return SpeedGrowth(float(np.sqrt(line.slope)), (float(low), float(high)), line.level, 0.5 * line.score**2)


@dataclass(frozen=True)
class _Line:
    """Slope of the variance along a law and its 95 % interval, its mean part and the level without it, its score."""

    slope: float
    ci95: tuple[float, float]
    grown: float
    level: float
    score: float
    chance: float


def _line(laws: FloatArray, variance: FloatArray, group: IntArray, stretch: IntArray) -> _Line | None:
    """Fit the variance along the first law, once what the others could say of it is taken off; None if it falls."""
    squared = laws[:, 0]
    if not len(group) or group.max() + 1 < 2 * SENSORS.side or not np.ptp(squared) > 0.0:
        return None
    slope, level, score, info = 0.0, 0.0, np.zeros(0), np.zeros(0)
    for _ in range(REWEIGHTED):
        weight = (level**2 + slope * squared) ** -2 if slope > 0.0 else np.ones(len(squared))
        centred = np.stack([law - _mean_of(law, weight, group) for law in laws.T], axis=1)
        apart, others = centred[:, 0], centred[:, 1:]
        if others.shape[1]:
            apart = apart - others @ solve((weight * others.T) @ others, (weight * others.T) @ apart)
        score = weight * apart * (variance - _mean_of(variance, weight, group))
        info = weight * apart**2
        slope = float(score.sum() / info.sum())
        rest = float(np.average(variance - slope * squared, weights=weight))
        level = np.sqrt(max(rest, SENSORS.least_change * slope * float(squared.mean())))
    if slope <= 0.0:
        return None
    scores, infos = np.bincount(stretch, score), np.bincount(stretch, info)
    size, freedom = float(scores.sum() / np.sqrt((scores**2).sum())), len(scores) - 1
    half = student.ppf(0.975, freedom) * float(np.sqrt(((scores - slope * infos) ** 2).sum()) / info.sum())
    ends = slope - half, slope + half
    return _Line(slope, ends, slope * float(squared.mean()), float(level), size, float(student.sf(size, freedom)))


def _other_laws(speeds: FloatArray, column: int) -> list[FloatArray]:
    """Return what the variance may follow instead `(n, p)`: any motion, another joint, or the pace of the arm."""
    typical = np.sqrt(np.mean(speeds**2, axis=0))
    others = [k for k in range(speeds.shape[1]) if k != column and typical[k] > 0.0]
    laws = [(speeds[:, [column]] > MOVING * typical[column]).astype(np.float64), *(speeds[:, [k]] ** 2 for k in others)]
    if others:
        pace = (speeds / np.maximum(speeds.max(axis=0), 1e-300)).max(axis=1)
        laws.append(np.stack([pace, pace**2], axis=1))
    return laws


def _mean_of(values: FloatArray, weight: FloatArray, group: IntArray) -> FloatArray:
    """Weighted mean of the own trajectory at every sample."""
    means: FloatArray = (np.bincount(group, weight * values) / np.bincount(group, weight))[group]
    return means


def _samples(
    residual: FloatArray, laws: FloatArray, trajectory: IntArray, rows: BoolArray, stated: float
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Laws, variance beyond what is stated by the first, trajectory and stretch of every sample with a variance."""
    parts = [(np.empty((0, laws.shape[1])), np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64))]
    for number in np.unique(trajectory[rows]):
        mine = rows & (trajectory == number)
        second, law = second_differences(residual[mine]), laws[mine]
        between = 0.5 * (law[1:-2] + law[2:-1])
        variance = NEIGHBOURS * second[1:] * second[:-1] - stated**2 * between[:, 0]
        known = np.isfinite(variance) & np.isfinite(between).all(axis=1)
        count = int(known.sum())
        if count >= SENSORS.fewest:
            stretch = parts[-1][3].max(initial=-1) + 1 + np.arange(count) // SENSORS.fewest
            parts.append((between[known], variance[known], np.full(count, len(parts) - 1), stretch))
    followed, variances, groups, stretches = zip(*parts, strict=True)
    return np.concatenate(followed), np.concatenate(variances), np.concatenate(groups), np.concatenate(stretches)
