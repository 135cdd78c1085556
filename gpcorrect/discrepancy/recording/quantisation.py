"""Whether values are written down in steps: their remainders then all agree (Widrow and Kollar 2008, Ch. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.settings import SENSORS
from gpcorrect.types import FloatArray

TRIES = 25  # step sizes near a first guess


@dataclass(frozen=True)
class Quantisation:
    """A step in which values are written down, in their unit, with the half width of what they leave open of it.

    `visited` counts differ.
    """

    step: float
    error: float
    visited: int


def quantisation_of(values: FloatArray) -> Quantisation | None:
    """Return the largest step on whose multiples (and a common remainder) values lie; None when there is none.

    Values rounded a second time, more finely, still count. Each value counts once, however long the joint rested there.

    Parameters
    ----------
    values : (n,) array
        rad or m.
    """
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < SENSORS.fewest_counts:
        return None
    gaps = np.diff(distinct)
    gaps = np.sort(gaps[gaps > 1e-9 * gaps.max()])
    jump = int(np.argmax(gaps[1:] / gaps[:-1])) + 1 if len(gaps) > 1 else 0
    guesses = {float(gaps[0]), float(np.median(gaps[jump:]))}  # the smallest, and that between groups of neighbours
    found = [c for guess in sorted(guesses) if (c := _fitted(distinct, guess)) is not None]
    return max(found, key=lambda c: c.step, default=None)


def _fitted(distinct: FloatArray, guess: float) -> Quantisation | None:
    """Best step near a guess, fitted over an ever wider range of values, so that no count is skipped."""
    step, base = guess, distinct[0]
    span = float(np.ptp(distinct))
    if span < (SENSORS.fewest_counts - 1) * guess:
        return None
    reach = 4.0 * guess
    while True:
        near = distinct[distinct - base <= reach]
        width = 0.3 * step**2 / max(reach, step)
        tried = step + width * np.linspace(-1.0, 1.0, TRIES)
        step = float(tried[int(np.argmax([_agreement(near, t) for t in tried]))])
        if reach >= span:
            break
        reach *= 2.0
    visited = len(np.unique(np.round((distinct - base) / step)))
    if _agreement(distinct, step) < SENSORS.agreement or visited < SENSORS.fewest_counts:
        return None
    return Quantisation(step, float(width), visited)


def _agreement(values: FloatArray, step: float) -> float:
    """From 0 for remainders that are spread evenly to 1 for all the same."""
    return float(np.abs(np.mean(np.exp(2j * np.pi * (values - values[0]) / step))))
