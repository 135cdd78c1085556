"""Mechanical stops: where joints end that are sent further, found in a recording.

A joint that its command or its motor's encoder has beyond a stop stands at the stop, whatever else is wrong with it. To
a law that sees a few such samples they are outliers, and elsewhere it runs on. So joints are taken back to their stops
before anything is learned or answered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.calibration.metrics import joint_units
from gpcorrect.errors import DataError
from gpcorrect.robust import robust_scale
from gpcorrect.types import BoolArray, FloatArray, frozen_array

TOP = 0.6
"""Of a joint's range, next to its end: a stop is looked for in its upper half, and judged by as much below. With 0.4 a
stop was missed that lay a quarter of the range inside; with 0.8 a slack as wide as a stroke is taken for one."""
CANDIDATES = 200  # places that are tried; chosen by hand
FEWEST_BEYOND, FEWEST_VISITS, FEWEST_BELOW = 4, 3, 8
"""Samples beyond a stop, arrivals of a joint that had left it (one that sticks in its slack, or a tracker that hung, is
at the same place for long, but once), and samples next to it, which say what error is usual; chosen by hand."""
LEFT = 0.25  # of what those samples miss without a stop, that a stop may leave; chosen by hand
CLEARLY = 2.0
"""Robust deviations of the error below a stop that joints must have been sent beyond it on average; by hand."""


@dataclass(frozen=True, eq=False)
class Stops:
    """Where joints end."""

    # (d,) each: as the robot's side has them, rad or m; infinite where no stop shows
    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", frozen_array(self.low))
        object.__setattr__(self, "high", frozen_array(self.high))
        if self.low.shape != self.high.shape or self.low.ndim != 1 or not (self.low < self.high).all():
            raise DataError(f"stops at {self.low} and {self.high} leave no room for joints.")

    @classmethod
    def of(cls, sent: FloatArray, ended: FloatArray) -> Self | None:
        """Return the stops that a recording shows; None where there are none.

        Parameters
        ----------
        sent, ended : (n, d) arrays
            Where joints were sent, and where they ended, in recorded order, rad or m; NaN where unknown.
        """
        known = np.isfinite(sent).all(axis=1) & np.isfinite(ended).all(axis=1)
        pairs = list(zip(sent[known].T, ended[known].T, strict=True))
        high = np.array([_upper(x, y) for x, y in pairs])
        low = -np.array([_upper(-x, -y) for x, y in pairs])
        return cls(low, high) if np.isfinite([low, high]).any() else None

    def reached(self, q: FloatArray) -> FloatArray:
        """Return joints `(..., d)` taken back to their stops.

        Parameters
        ----------
        q : (..., d) array, rad or m
        """
        return np.clip(q, self.low, self.high)

    def remarks(self, sent: FloatArray, types: str, signal: str) -> list[str]:
        """Return a sentence for each joint with a stop.

        Parameters
        ----------
        sent : (n, d) array, where joints were sent, rad or m
        types : str, R or P for each joint
        signal : str, of the robot's side, in which stops are
        """
        sentences = []
        for j, (unit, scale) in enumerate(zip(*joint_units(types), strict=True)):
            for stop, rows in ((self.low[j], sent[:, j] < self.low[j]), (self.high[j], sent[:, j] > self.high[j])):
                if np.isfinite(stop):
                    where = f"joint {j + 1} ends at {scale * stop:.1f} {unit} of {signal}"
                    sentences.append(f"{where}; it is further in {rows.sum()} samples")
        return sentences


def _upper(sent: FloatArray, ended: FloatArray) -> float:
    """Return where joints that were sent to `(n,)` end above; infinite where no stop shows.

    Each place that may be the stop is judged by the samples beyond it and those as far below it.
    """
    near = np.flatnonzero(sent >= sent.max() - TOP * np.ptp(sent)) if len(sent) else np.zeros(0, dtype=np.int64)
    near = near[np.argsort(sent[near], kind="stable")]
    x, error = sent[near], ended[near] - sent[near]
    best, stop = 0.0, np.inf
    for place in np.linspace((x[0] + x[-1]) / 2, x[-1], CANDIDATES) if len(x) else ():
        below, above = np.searchsorted(x, (2 * place - x[-1], place))
        if above - below < FEWEST_BELOW or len(x) - above < FEWEST_BEYOND:
            continue
        usual = float(np.median(error[below:above]))
        further = x[above:] - place
        without, with_stop = np.abs(error[above:] - usual).sum(), np.abs(error[above:] + further - usual).sum()
        gain = float(without - with_stop)
        if gain <= best or with_stop > LEFT * without:
            continue
        sure = further.mean() > CLEARLY * robust_scale(np.abs(error[below:above] - usual))
        if sure and _arrivals(sent > place, ended < 2 * place - x[-1] + usual) >= FEWEST_VISITS:
            best, stop = gain, float(place)
    return stop


def _arrivals(there: BoolArray, away: BoolArray) -> int:
    """Return how often a joint came there, of n samples in recorded order, having been away in between."""
    marks = np.where(there, 1, np.where(away, -1, 0))
    marks = marks[marks != 0]
    return int(((marks == 1) & (np.append(-1, marks[:-1]) == -1)).sum())
