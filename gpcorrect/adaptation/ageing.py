"""How long a model will still be useful: a straight line through its scores over time, and how sure that line is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Ageing", "estimate_ageing"]

RESAMPLES = 1000
ENOUGH_LOGS = 5  # from which whole logs are resampled: trajectories of one day err together
Z95 = 1.959964
TAIL = 2.5  # percent on each side of an interval


@dataclass(frozen=True, eq=False)
class Ageing:
    """What the history of a model says of its future, times in the unit of the ages that were given.

    Parameters
    ----------
    ageing : bool
        Whether the scores grow beyond chance: the 95 % interval of the slope lies above zero.
    slope, slope95 : float and pair
        Growth of the score in one unit of time, and its interval.
    limit : float
        Score at which the model is called worn out.
    remaining : float or None
        Time from the newest log until the line reaches the limit; 0 when it has; None when the model does not age.
    remaining95 : pair or None
        Its interval; the upper end is infinite when the data do not exclude that ageing stops.
    level : float
        Of the line at the newest log.
    """

    ageing: bool
    slope: float
    slope95: tuple[float, float]
    limit: float
    remaining: float | None
    remaining95: tuple[float, float] | None
    level: float


def estimate_ageing(
    baseline: FloatArray, scores: FloatArray, ages: FloatArray, logs: IntArray, limit: float, rng: np.random.Generator
) -> Ageing:
    """Extrapolate scores `(n,)` at ages `(n,)` since the fit, together with those of the training `(b,)` at age zero.

    Parameters
    ----------
    baseline, scores : (b,) and (n,) arrays
        As for the sequential test.
    ages : (n,) array
        Time since the fit.
    logs : (n,) array
        Which log a score comes from.
    limit : float
        Worn out means this many times the baseline's mean.
    rng : numpy.random.Generator
        Draws the bootstrap's samples.

    Raises
    ------
    DataError
        Ages are not positive, or the limit is not above 1.
    """
    if not (np.isfinite(ages).all() and (ages > 0).all()):
        raise DataError("the age of a log must be more than zero: the model was fitted at age zero.")
    if not limit > 1:
        raise DataError(f"worn out must mean more than 1 times the score at the fit, got {limit:g}.")
    worn, newest = limit * float(baseline.mean()), float(ages.max())
    slope, level = _line(baseline, scores, ages, newest)
    drawn = np.array([_line(*_resampled(baseline, scores, ages, logs, rng), newest) for _ in range(RESAMPLES)])
    lines = np.array([slope, level]) + _inflation(logs) * (drawn - drawn.mean(axis=0))
    low, high = np.percentile(lines[:, 0], [TAIL, 100 - TAIL])
    known = Ageing(bool(low > 0), slope, (float(low), float(high)), worn, None, None, level)
    if not known.ageing:
        return known
    with np.errstate(divide="ignore"):
        left = np.where(lines[:, 0] > 0, (worn - lines[:, 1]) / np.maximum(lines[:, 0], 0.0), np.inf)
    ends = np.percentile(np.maximum(left, 0.0), [TAIL, 100 - TAIL], method="nearest")
    remaining = max((worn - level) / slope, 0.0)
    return Ageing(True, slope, known.slope95, worn, remaining, (float(ends[0]), float(ends[1])), level)


def _inflation(logs: IntArray) -> float:
    """By how much a bootstrap of few units is too narrow: their lost degree of freedom, and Student's t for 1.96."""
    names = len(np.unique(logs))
    units = names if names >= ENOUGH_LOGS else len(logs)
    return float(np.sqrt(units / max(units - 1, 1)) * student.ppf(1 - TAIL / 100, max(units - 1, 1)) / Z95)


def _line(baseline: FloatArray, scores: FloatArray, ages: FloatArray, newest: float) -> tuple[float, float]:
    """Slope of the least-squares line, and its level at the newest age."""
    t = np.concatenate([np.zeros(len(baseline)), ages])
    y = np.concatenate([baseline, scores])
    centred = t - t.mean()
    slope = float(centred @ y / (centred @ centred))
    return slope, float(y.mean() + slope * (newest - t.mean()))


def _resampled(
    baseline: FloatArray, scores: FloatArray, ages: FloatArray, logs: IntArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw baseline scores and whole logs, or trajectories where logs are few, with replacement."""
    names = np.unique(logs)
    if len(names) >= ENOUGH_LOGS:
        rows = np.concatenate([np.flatnonzero(logs == name) for name in rng.choice(names, len(names))])
    else:
        # Within each log, so that every draw holds every age.
        rows = np.concatenate([_redrawn(np.flatnonzero(logs == name), rng) for name in names])
    return rng.choice(baseline, len(baseline)), scores[rows], ages[rows]


def _redrawn(rows: IntArray, rng: np.random.Generator) -> IntArray:
    drawn: IntArray = rng.choice(rows, len(rows))
    return drawn
