"""The time offset between two recordings of one motion, with its confidence interval or why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.streams import Stream, default_max_gap
from gpcorrect.logs.sync.correlation import LagCurve, lag_curve, peaks, slower_step
from gpcorrect.logs.sync.drift import ClockDrift, with_drift
from gpcorrect.logs.sync.motion import REFERENCES, MotionPair, pairs_of, stream_pair, stretches
from gpcorrect.logs.sync.refine import MIN_INFORMATION, MIN_SHARE, Refinement, Timing, block_sums
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, frozen_array

Verdict = Literal["found", "too_few", "still", "steady", "unrelated", "edge", "ambiguous", "imprecise"]
Finding = tuple[Verdict, str]
FOUND: Finding = ("found", "")

MAX_LAG = 2.0  # s; clocks of one network and pipelines of one tracker differ by less
MAX_LAG_STEPS = 5.0  # slow recordings are searched at least this many samples either way
MAX_LAG_SHARE = 0.25
"""Of the time recorded. Of 16 simulated logs of 2 or 3 reaches (1.5 to 5 s) searched over 2 s, 4 gave a false offset of
a second and more, because one reach looks like a piece of another; searched over a quarter, none did."""
SILENCE = 4.0  # times the largest lag: a longer silence cuts a recording into pieces
MIN_VARIATION = 0.05  # of the speed: below it the speed is constant as far as a correlation can tell
MIN_CORRELATION = 0.3  # two unrelated speeds of some tens of strokes stay below
MIN_EXPLAINED = 0.5  # a reference that explains less than half of the spread is not the same motion
MAX_RIVALS = 8  # a reason names no more
PEAK_WIDTH = 0.2  # s; a peak, blurred by noise and by strokes of a second, lies this close to the offset
PEAK_STEPS = 3.0  # or this many samples of the slower signal, if that is more
DISTINCT_STEPS = 1.0  # optima within a slow sample step of each other are the same
MIN_COMPARED = 2.5
"""s of motion. Simulated reaches gave wrong offsets of 0.2 to 1.7 s, each with a narrow interval, from 0.6 to 2.1 s."""
MOST = 50_000
"""Observed samples that are fitted, evenly spread: an hour at 14 Hz. Of 240,000 samples at 1 kHz offsets of 5 and 29 ms
and their intervals come out alike to 0.1 us, in two fifths of the time."""
MAX_HALF_WIDTH = 0.1  # of the searched lag: a wider interval is no answer

MIN_OVERLAP = 0.2  # of the samples must be common to two rivals to compare them sample by sample
RIVAL_LEVEL = 3.0  # standard errors by which the best fit must beat a rival
RIVAL_RATIO = 1.10  # and its loss must be better by this factor: a model error can be significant as well


@dataclass(frozen=True, eq=False)
class TimeOffset:
    """Seconds d by which the observer's stamps run ahead: observed(t + d) shows what reference(t) shows.

    Parameters
    ----------
    offset : float, s; the best guess when ambiguous, NaN when there is none
    ci95 : (float, float), 95 % confidence interval, s; NaN when there is none
    verdict : str
        "found", or what stands in the way: "too_few" samples in common, a "still" or "steady" reference,
        "unrelated" motions, an offset at the "edge" of the search or beyond it, an "ambiguous" (repeating)
        motion, an "imprecise" answer.
    reason : str, the same in words; empty when found
    lags, correlation : (m,) arrays, pooled correlation of the speeds, for a plot; empty when nothing could be compared
    rivals : tuple of float, other offsets that explain the recording as well, s
    drift : ClockDrift or None, only where it is significant
    trajectories : (k,) int array, numbers of the trajectories compared
    per_trajectory : (k,) array, offset of each of them by itself, s; NaN where it says nothing
    explained : float, share of the observed spread that the shifted reference explains; NaN when there is no offset
    samples : int, observed samples compared
    observed, reference : str, names of the signals
    """

    offset: float
    ci95: tuple[float, float]
    verdict: Verdict
    reason: str
    lags: FloatArray
    correlation: FloatArray
    rivals: tuple[float, ...] = ()
    drift: ClockDrift | None = None
    trajectories: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    per_trajectory: FloatArray = field(default_factory=lambda: np.empty(0))
    explained: float = float("nan")
    samples: int = 0
    observed: str = ""
    reference: str = ""

    @property
    def observable(self) -> bool:
        """Whether the motion determines the offset."""
        return self.verdict == "found"

    def at(self, time: FloatArray) -> FloatArray:
        """Offset `(n,)`, s: constant unless there is a drift.

        Parameters
        ----------
        time : (n,) array, by the observer's clock, s
        """
        rate, epoch = (0.0, 0.0) if self.drift is None else (1e-6 * self.drift.ppm, self.drift.epoch)
        return self.offset + rate * (np.asarray(time, dtype=np.float64) - epoch)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able summary without the curve; what is not known is None."""
        known = bool(np.isfinite(self.offset))
        drift = self.drift and {"ppm": self.drift.ppm, "ci95": list(self.drift.ci95), "epoch": self.drift.epoch}
        return {
            "observed": self.observed,
            "reference": self.reference,
            "offset_s": self.offset if known else None,
            "ci95_s": list(self.ci95) if np.isfinite(self.ci95).all() else None,
            "observable": self.observable,
            "verdict": self.verdict,
            "reason": self.reason,
            "rivals_s": list(self.rivals),
            "drift": drift,
            "explained": self.explained if np.isfinite(self.explained) else None,
            "samples": self.samples,
        }


def log_offset(log: CalibrationLog, observed: str | None = None, reference: str | None = None) -> TimeOffset:
    """Time offset between two signals of a log, trajectory by trajectory and pooled.

    Parameters
    ----------
    log : CalibrationLog, any; its stamps may be disordered
    observed, reference : str, optional
        Signals to compare; by default the tracker with what the robot reports, else with the command, else
        joints alike.

    Raises
    ------
    LogError
        The log does not hold two comparable signals.
    """
    if observed is None or reference is None:
        pairs_here = ((o, r) for o, references in REFERENCES.items() for r in references if {o, r} <= {*log.signals})
        chosen = next(pairs_here, None)
        if chosen is None:
            found = ", ".join(log.signals) or "no signal"
            hint = "Record the command (setpoint_cp or setpoint_jp) beside what was observed."
            raise LogError(f"expected two signals of one motion, got {found}.", hint=hint)
        observed, reference = observed or chosen[0], reference or chosen[1]
    if log.static:
        return replace(_nothing(("too_few", "static poses have no clock.")), observed=observed, reference=reference)
    pairs = pairs_of(log, observed, reference)
    return estimate_offset(pairs, names=(observed, reference))


def stream_offset(
    observed: Stream, reference: Stream, *, max_lag: float | None = None, centre: float = 0.0
) -> TimeOffset:
    """Time offset between two streams, each on its own clock and at its own rate.

    What is found is how far `observed` runs ahead: `observed.shifted(-offset)` is on the reference's clock.

    Parameters
    ----------
    observed, reference : Stream, both poses or both joints, else a LogError
    max_lag, centre : float, optional, see :func:`estimate_offset`
    """
    pairs = [stream_pair(observed, reference)]
    return estimate_offset(pairs, max_lag=max_lag, centre=centre, names=(observed.name, reference.name))


def estimate_offset(
    pairs: Sequence[MotionPair],
    *,
    max_lag: float | None = None,
    centre: float = 0.0,
    names: tuple[str, str] = ("observed", "reference"),
) -> TimeOffset:
    """Time offset d such that observed(t + d) is the motion of reference(t), whatever frames and units.

    Peaks of the correlation of the two speeds are candidates; each is refined by least squares of observed
    positions on the shifted reference, and the best of them stands if no other explains the recording as
    well. A constant delay of the robot behind its command moves the observed signal exactly as a clock
    offset does: the two cannot be told apart from motion.

    Parameters
    ----------
    pairs : sequence of MotionPair
        One for each run of the clocks, or one a trajectory where each starts its clocks anew.
    max_lag : float, optional
        Largest distance from `centre` searched, s; by default 2 s, or a quarter of the time recorded if that is
        less, but at least five samples of the slower signal.
    centre : float, where to search: a rough offset, when the clocks have different origins
    names : (str, str), of the observed and the reference signal, for messages

    Raises
    ------
    DataError
        `max_lag` is not positive.
    """
    if max_lag is not None and not max_lag > 0:
        raise DataError(f"max_lag must be positive seconds, got {max_lag}.")
    moved = [replace(p, observed=replace(p.observed, time=p.observed.time - centre)) for p in pairs]
    found = _estimate(moved if centre else pairs, max_lag, names)
    low, high = found.ci95
    return replace(
        found,
        offset=found.offset + centre,
        ci95=(low + centre, high + centre),
        lags=frozen_array(found.lags + centre),
        correlation=frozen_array(found.correlation),
        rivals=tuple(r + centre for r in found.rivals),
        drift=found.drift and replace(found.drift, epoch=found.drift.epoch + centre),
        per_trajectory=frozen_array(found.per_trajectory + centre),
        observed=names[0],
        reference=names[1],
    )


def rough_offsets(log: CalibrationLog, observed: str, reference: str) -> FloatArray:
    """Offsets (k,), s, at which two signals' speeds correlate best, the best first: cheap beside :func:`log_offset`.

    Parameters
    ----------
    log : CalibrationLog
    observed, reference : str, signals
    """
    pairs = pairs_of(log, observed, reference)
    known = np.isfinite(slower_step(pairs)) and any(p.reference.values.size for p in pairs)
    pieces, reach = _compared(pairs, None) if known else ([], 0.0)
    return peaks(lag_curve(pieces, reach)) if pieces else np.empty(0)


def _nothing(finding: Finding, curve: LagCurve | None = None) -> TimeOffset:
    nan = float("nan")
    lags, correlation = (np.empty(0), np.empty(0)) if curve is None else (curve.lags, curve.correlation)
    return TimeOffset(nan, (nan, nan), *finding, lags, correlation)


def _estimate(pairs: Sequence[MotionPair], max_lag: float | None, names: tuple[str, str]) -> TimeOffset:
    if not np.isfinite(slow := slower_step(pairs)):
        return _nothing(("too_few", "there are too few samples to compare."))
    if not any(p.reference.values.size for p in pairs):
        return _nothing(("still", f"{names[1]} does not move."))
    pieces, reach = _compared(pairs, max_lag)
    if not pieces:
        return _nothing(("too_few", "the two signals share no time."))
    curve = lag_curve(pieces, reach)
    finding = _coarse_finding(curve, names)
    if finding[0] != "found":
        return _nothing(finding, curve)
    return _refined(pieces, curve, slow, reach, names)


def _compared(pairs: Sequence[MotionPair], max_lag: float | None) -> tuple[list[MotionPair], float]:
    """Stretches that both signals have, and the greatest lag at which they are compared, s."""
    slow = slower_step(pairs)
    steps = [(np.diff(p.reference.time), default_max_gap(p.reference.time)) for p in pairs]
    recorded = sum(float(step[step <= gap].sum()) for step, gap in steps)
    reach = max_lag or max(min(MAX_LAG, MAX_LAG_SHARE * recorded), MAX_LAG_STEPS * slow)
    silence = max(SILENCE * reach, 2 * slow)
    return [s for p in pairs for s in stretches(p, silence, reach) if min(len(s.observed), len(s.reference)) > 1], reach


def _coarse_finding(curve: LagCurve, names: tuple[str, str]) -> Finding:
    """Whether the speeds alone promise an answer."""
    observed, reference = names
    if curve.variation == 0.0:
        return "still", f"{reference} does not move."
    if curve.variation < MIN_VARIATION:
        return "steady", f"{reference} moves at constant speed: a shift in time looks like a shift in space."
    best = float(np.nanmax(curve.correlation)) if np.isfinite(curve.correlation).any() else 0.0
    if best < MIN_CORRELATION:
        how = f"their speeds correlate by {best:.2f} at best{_searched(curve)}"
        return "unrelated", f"{observed} does not move as {reference} does: {how}."
    at = int(np.nanargmax(curve.correlation))
    if at in (0, len(curve.lags) - 1):
        return "edge", f"the correlation still rises at {curve.lags[at]:+.3g} s, where the search ends."
    return FOUND


def _searched(curve: LagCurve) -> str:
    """Say where the speeds could be compared: short trajectories shorten the search."""
    lags = curve.lags[np.isfinite(curve.correlation)]
    return f" between {lags[0]:+.2g} and {lags[-1]:+.2g} s" if lags.size else ""


def _refined(
    pieces: Sequence[MotionPair], curve: LagCurve, slow: float, reach: float, names: tuple[str, str]
) -> TimeOffset:
    bracket = max(PEAK_WIDTH, PEAK_STEPS * slow)
    every = max(1, sum(len(p.observed) for p in pieces) // MOST)
    pieces = [replace(p, observed=p.observed.rows(np.arange(0, len(p.observed), every))) for p in pieces]
    starts = peaks(curve)[: MAX_RIVALS + 1]
    timing = regression(pieces, starts)
    if timing is None:
        return _nothing(("too_few", "there are too few samples to tell offset from registration."), curve)
    fits = [fit for s in starts if (fit := timing.refine(np.array([s]), bracket)) is not None]
    if not fits:
        return _nothing(("unrelated", f"no shift of {names[1]}{_searched(curve)} fits {names[0]}."), curve)
    first, *rest = _distinct(fits, DISTINCT_STEPS * slow)
    equals = [first, *(fit for fit in rest if _as_good(fit, first))]
    best, *others = sorted(equals, key=lambda fit: abs(float(fit.timing[0])))
    rivals = tuple(float(f.timing[0]) for f in others)
    drift, best = with_drift(timing, best, pieces, reach)
    offset, width = float(best.timing[0]), float(best.half_width()[0])
    return TimeOffset(
        offset,
        (offset - width, offset + width),
        *_fine_finding(best, width, rivals, reach, slow, names),
        curve.lags,
        curve.correlation,
        rivals,
        drift,
        *_per_trajectory(timing, best),
        best.explained,
        int(best.valid.sum()),
    )


def regression(pieces: Sequence[MotionPair], starts: FloatArray) -> Timing | None:
    """Set up the regression, without slack and then lever arms where samples are few, not at all where they are fewer.

    Parameters
    ----------
    pieces : sequence of MotionPair, what to compare; a drift turns about the middle of their observed stamps
    starts : (k,) array, shifts, s; enough samples must be in common at one of them
    """
    stamps = np.concatenate([p.observed.time for p in pieces])
    epoch = float((stamps.min() + stamps.max()) / 2)
    plain = [replace(p, reference=replace(p.reference, lever=None)) for p in pieces]
    for timing in (Timing(pieces, epoch), Timing(pieces, epoch, slack=False), Timing(plain, epoch, slack=False)):
        if any(timing.enough(timing.sample(np.array([s])).valid) for s in starts):
            return timing
    return None


def _fine_finding(
    fit: Refinement, width: float, rivals: tuple[float, ...], reach: float, slow: float, names: tuple[str, str]
) -> Finding:
    observed, reference = names
    compared = slow * int(fit.valid.sum())
    if compared < MIN_COMPARED:
        return "too_few", f"only {compared:.1f} s of motion could be compared."
    if fit.explained < MIN_EXPLAINED:
        fraction = f"{max(fit.explained, 0.0):.0%}"
        return "unrelated", f"{reference} explains only {fraction} of where {observed} was."
    if fit.information < MIN_INFORMATION:
        return ("steady", "the motion is a line or circle at constant speed: a shift in time looks like one in space.")
    if rivals:
        shifts = ", ".join(f"{r:+.3f}" for r in rivals)
        return "ambiguous", f"the motion repeats: {fit.timing[0]:+.3f} s fits no better than {shifts} s."
    if width > MAX_HALF_WIDTH * reach:
        return "imprecise", f"the motion determines the offset to +-{width:.2g} s only."
    return FOUND


def _per_trajectory(timing: Timing, fit: Refinement) -> tuple[IntArray, FloatArray]:
    """One Gauss-Newton step of each trajectory by itself from the common offset."""
    numbers, place = np.unique(timing.label, return_inverse=True)
    score = np.bincount(place, weights=fit.score[:, 0])
    hessian = np.bincount(place, weights=fit.hessian[:, 0, 0])
    enough = hessian > MIN_SHARE * hessian.mean()
    offsets = np.full(len(numbers), np.nan)
    offsets[enough] = fit.timing[0] + score[enough] / hessian[enough]
    return numbers, offsets


def _distinct(fits: Sequence[Refinement], apart: float) -> list[Refinement]:
    """Fits in order of what they explain, without those that converged beside a better one."""
    found: list[Refinement] = []
    for fit in sorted(fits, key=lambda f: -f.explained):
        if all(abs(fit.timing[0] - f.timing[0]) > apart for f in found):
            found.append(fit)
    return found


def _as_good(rival: Refinement, best: Refinement) -> bool:
    """Whether the best fit does not beat the rival clearly and significantly, on the samples of both if it can be."""
    loss, least = rival.loss(best.scale), best.loss(best.scale)
    both = rival.valid & best.valid
    if both.sum() < MIN_OVERLAP * best.valid.sum():
        return float(loss[rival.valid].mean()) < RIVAL_RATIO * float(least[best.valid].mean())
    a, b = loss[both], least[both]
    sums = block_sums((a - b)[:, None])[:, 0]
    error = float(np.sqrt(len(sums)) * sums.std(ddof=1))
    return float(sums.sum()) < RIVAL_LEVEL * error or float(a.sum()) < RIVAL_RATIO * float(b.sum())
