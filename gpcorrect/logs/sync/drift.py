"""Whether one clock runs fast against another: only where all parts of a recording say so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit  # scipy.stats has it too, and takes half a second to import

from gpcorrect.logs.sync.motion import MotionPair
from gpcorrect.logs.sync.refine import MIN_SHARE, Refinement, Timing

MIN_DRIFT_SPAN = 60.0  # s; a shorter recording cannot show a drift of parts in a million
PARTS = 12  # of equal time, whose offsets tell how evenly a clock runs; chosen by hand
INTERVAL = 0.95
DRIFT_LEVEL = 0.999  # confidence at which a drift is reported: asked of every log, so rarely wrong
MIN_DRIFT_SHIFT = 1e-3  # s over the recording; less does not matter at any sample rate here


@dataclass(frozen=True)
class ClockDrift:
    """How the offset changes: one clock runs fast.

    Parameters
    ----------
    ppm : float, parts in a million that the observer's clock runs fast against the reference's
    ci95 : (float, float), 95 % confidence interval, ppm
    epoch : float, observer's time at which the offset is quoted, s
    """

    ppm: float
    ci95: tuple[float, float]
    epoch: float


def with_drift(
    timing: Timing, fit: Refinement, pieces: Sequence[MotionPair], reach: float
) -> tuple[ClockDrift | None, Refinement]:
    """Fit a drift too where one clock runs throughout; take it when it is significant and matters.

    Parameters
    ----------
    timing : Timing, of the pieces
    fit : Refinement, of a constant offset
    pieces : sequence of MotionPair, in order
    reach : float, how far the offset is searched, s
    """
    starts = np.array([p.observed.time[0] for p in pieces])
    span = float(pieces[-1].observed.time[-1] - starts[0])
    if span < MIN_DRIFT_SPAN or (np.diff(starts) <= 0).any():  # the clock starts anew between pieces
        return None, fit
    both = timing.refine(np.array([fit.timing[0], 0.0]), bracket=reach)
    if both is None:
        return None, fit
    rate, widths = float(both.timing[1]), _drift_widths(timing, both)
    if abs(rate) <= widths[DRIFT_LEVEL] or abs(rate) * span < MIN_DRIFT_SHIFT:
        return None, fit
    width = widths[INTERVAL]
    return ClockDrift(1e6 * rate, (1e6 * (rate - width), 1e6 * (rate + width)), timing.epoch), both


def _drift_widths(timing: Timing, fit: Refinement) -> dict[float, float]:
    """Half widths by levels of a drift's intervals, s/s: by the samples or, where wider, by parts of the recording.

    Play and creep make one part late and another early, which no clock does; samples, which are not independent for as
    long as a motion lasts, say too little of it.
    """
    part = np.clip(((timing.elapsed - timing.elapsed.min()) / np.ptp(timing.elapsed) * PARTS).astype(int), 0, PARTS - 1)
    score, hessian, at = (
        np.bincount(part, weights=weights, minlength=PARTS)
        for weights in (fit.score[:, 0], fit.hessian[:, 0, 0], fit.hessian[:, 0, 0] * timing.elapsed)
    )
    known = hessian > MIN_SHARE * hessian.mean()
    errors = [(float(np.sqrt(fit.covariance[1, 1])), max(fit.dof, 1))]
    if (free := int(known.sum()) - 2) > 0:
        late, middle = score[known] / hessian[known], at[known] / hessian[known]
        late, middle = late - late.mean(), middle - middle.mean()
        errors.append((float(np.sqrt((late**2).sum() / free / (middle**2).sum())), free))
    levels = (DRIFT_LEVEL, INTERVAL)
    return {level: max(float(stdtrit(dof, 0.5 + level / 2)) * error for error, dof in errors) for level in levels}
