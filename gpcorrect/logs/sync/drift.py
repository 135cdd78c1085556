"""Does one clock run fast? A shift that grows through the recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student_t

from gpcorrect.logs.sync.motion import MotionPair
from gpcorrect.logs.sync.offset import ClockDrift
from gpcorrect.logs.sync.refine import Refinement, Timing

__all__ = ["with_drift"]

MIN_DRIFT_SPAN = 60.0  # s; a shorter recording cannot show a drift of parts in a million
DRIFT_LEVEL = 0.999  # confidence at which a drift is reported: asked of every log, so rarely wrong
MIN_DRIFT_SHIFT = 1e-3  # s over the recording; less does not matter at any sample rate here


def with_drift(
    timing: Timing, fit: Refinement, pieces: Sequence[MotionPair], reach: float
) -> tuple[ClockDrift | None, Refinement]:
    """Fit a drift too where one clock runs throughout; keep it when it is significant and matters."""
    span = _running_span(pieces)
    if span < MIN_DRIFT_SPAN:
        return None, fit
    both = timing.refine(np.array([fit.timing[0], 0.0]), bracket=reach)
    if both is None:
        return None, fit
    rate, error = float(both.timing[1]), float(np.sqrt(both.covariance[1, 1]))
    level = float(student_t.ppf(0.5 + DRIFT_LEVEL / 2, max(both.dof, 1)))
    if abs(rate) <= level * error or abs(rate) * span < MIN_DRIFT_SHIFT:
        return None, fit
    width = float(both.half_width()[1])
    return ClockDrift(1e6 * rate, (1e6 * (rate - width), 1e6 * (rate + width)), timing.epoch), both


def _running_span(pieces: Sequence[MotionPair]) -> float:
    """Seconds from the first to the last observed stamp; 0 when the clock starts anew between pieces."""
    starts = np.array([p.observed.time[0] for p in pieces])
    stops = np.array([p.observed.time[-1] for p in pieces])
    if (np.diff(starts) <= 0).any():
        return 0.0
    return float(stops[-1] - starts[0])
