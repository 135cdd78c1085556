"""Put signals of a log on one clock: by seconds that are known, or by the motion where it leaves no doubt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.sync.estimate import TimeOffset, log_offset, regression
from gpcorrect.logs.sync.motion import REFERENCES, clock_runs, pairs_of
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

PLAUSIBLE_LAG = (0.0, 0.15)
"""s: a servo follows its command within this time and never runs ahead of it; recorded: 13 to 47 ms on a dVRK."""

USUAL_LAG = 0.05
"""s: of a servo behind its command, as recorded; a person must know of more, which may be a sensor's delay. A tracker's
120 ms, learned as the robot's lag, sent an outsider's arm 15 mm off where it had missed by 6."""

MAX_MISFIT = 0.5
"""Of what the nearest plausible lag leaves. Simulated: planted clocks of 0.3 to 1.2 s leave 0.03 to 0.4, play in the
drive that looked like 0.38 s left 0.95, and one reach taken for another 0.5 to 1.3."""

NAMES = {"tracker_cp": "the tracker", "external_jp": "the outside encoders"}


@dataclass(frozen=True, eq=False)
class Clocks:
    """What was found of a signal's clock, and what was done about it.

    Parameters
    ----------
    offset : TimeOffset or None, estimate of how far the signal's stamps run ahead; None when it was not asked for
    applied : float, seconds by which the signal was shifted; 0 when it was left alone
    remark : str, the same in a sentence
    to_note : bool
        Whether a person must know: the signal was shifted, or seems to be on another clock and was left alone.
    """

    offset: TimeOffset | None
    applied: float
    remark: str
    to_note: bool = False

    @property
    def notes(self) -> tuple[str, ...]:
        """The remark, where a person must know."""
        return (self.remark,) if self.to_note else ()


def match_clocks(
    log: CalibrationLog, moving: str, reference: str, mode: str, *, shifts: bool = True
) -> tuple[CalibrationLog, Clocks]:
    """Return the log with one signal on the clock of another, as `mode` says.

    "auto" shifts only what cannot be the robot's own lag, which is part of how it misses and is learned, and only
    where the recording leaves no doubt: an interval narrower than the effect, and at most half of the misfit left that
    the nearest plausible lag leaves. Hysteresis looks like a late clock, but a shift does not explain it; with few
    reaches a wrong shift fits one reach to another.

    Parameters
    ----------
    log : CalibrationLog, not changed
    moving, reference : str
        The signal that another clock may have stamped, and what it is compared with: both poses or both joints. What
        the robot reports is taken instead of what it was commanded, where the log holds it: it lags less.
    mode : {"auto", "none"} or str, "none" leaves the stamps alone; a number shifts the signal by so many seconds
    shifts : bool, whether "auto" shifts; it only says what it found otherwise

    Returns
    -------
    CalibrationLog
        Same rows; NaN in the signal where nothing is near in time after a shift.
    Clocks
        What was found and done.

    Raises
    ------
    LogError
        The log lacks one of the two signals, or has no clock to shift.
    DataError
        `mode` is none of these.
    """
    for name in (moving, reference):
        if name not in log.signals:
            raise LogError(f"there is no {name}.", hint=f"Present: {', '.join(log.signals) or 'none'}.", path=log.name)
    name = NAMES.get(moving, moving)
    if mode == "none":
        return log, Clocks(None, 0.0, f"the stamps of {name} were taken as they are")
    if mode != "auto":
        seconds = seconds_of(mode)
        remark = f"{name} was shifted by the {seconds:g} s that were given"
        return align(log, seconds, signals=(moving,)), Clocks(None, seconds, remark, to_note=seconds != 0.0)
    reference = next(signal for signal in (*REFERENCES.get(moving, ()), reference) if signal in log.signals)
    found = log_offset(log, moving, reference)
    if not found.observable:
        return log, Clocks(found, 0.0, f"the time offset of {name} is not observable: {found.reason}")
    size = _size(found)
    inside = np.diff(log.trajectory) == 0
    step = float(np.median(np.diff(log.time)[inside])) if inside.any() else 0.0  # less is not worth an interpolation
    if PLAUSIBLE_LAG[0] - step <= found.ci95[1] and found.ci95[0] <= PLAUSIBLE_LAG[1] + step:
        return log, _left(found, size, step)
    doubt = _doubt(log, found, float(np.clip(found.offset, *PLAUSIBLE_LAG)))
    if doubt:
        remark = f"{size}, but {doubt}: left alone; if it is the clock: --time-offset motion"
        return log, Clocks(found, 0.0, remark, to_note=True)
    if not shifts:
        remark = f"{size}, more than a servo does: left as it was stamped; if the clocks differ: --time-offset motion"
        return log, Clocks(found, 0.0, remark, to_note=True)
    remark = f"{size}, more than a servo does: {name} was shifted"
    return align(log, found, signals=(moving,)), Clocks(found, found.offset, remark, to_note=True)


def shifted_by_motion(log: CalibrationLog) -> CalibrationLog:
    """Return the log with its outside sensors shifted by all that the motion says, drift included.

    For sensors that are known to be late, or on a clock of their own: a lag of the robot behind its command is taken
    out too where the log does not hold what the robot reports.

    Parameters
    ----------
    log : CalibrationLog, not changed

    Returns
    -------
    CalibrationLog
        With a remark for each sensor that was shifted; the same log where there is none.

    Raises
    ------
    DegenerateError
        The motion does not determine an offset.
    """
    for name in NAMES:
        reference = next((r for r in REFERENCES[name] if {name, r} <= {*log.signals}), None)
        if reference is not None:
            found = log_offset(log, name, reference)
            moved = align(log, found, signals=(name,))
            log = replace(moved, remarks=(*log.remarks, f"{_size(found)}: shifted, as asked"))
    return log


def _size(found: TimeOffset) -> str:
    """By how much a sensor is late, and behind what."""
    middle, low, high = (1e3 * seconds for seconds in (found.offset, *found.ci95))
    what = "the commands" if found.reference.startswith("setpoint") else "what the robot reports"
    drift = "" if found.drift is None else f", and its clock {found.drift.ppm:+.0f} ppm against theirs"
    name = NAMES.get(found.observed, found.observed)
    runs = f"{name} run{'' if name.endswith('s') else 's'}"
    return f"{runs} {middle:.1f} ms behind {what} (95 %: {low:.1f} to {high:.1f}){drift}"


def _left(found: TimeOffset, size: str, step: float) -> Clocks:
    """Leave a plausible lag alone; say it where no velocity feature learns it: a clock that drifts, a camera's delay.

    No servo explains that the sensor runs behind the pose that the robot reports by more than a step of the log.
    """
    if found.reference == "measured_cp" and found.ci95[0] > step:
        remark = f"{size}: left as it was stamped. Slack looks late too; if it is the sensor: --time-offset motion"
        return Clocks(found, 0.0, remark, to_note=True)
    remark = f"{size}, as a servo may: left to the velocity features"
    if found.drift is None:
        remark += "; if some of it is the sensor's delay: --time-offset SECONDS" if found.ci95[0] > USUAL_LAG else ""
        return Clocks(found, 0.0, remark, to_note=found.ci95[0] > USUAL_LAG)
    return Clocks(found, 0.0, f"{remark}, which cannot follow a clock: --time-offset motion", to_note=True)


def _doubt(log: CalibrationLog, found: TimeOffset, lag: float) -> str:
    """Why not to believe that the clocks differ rather than that the robot lags so much; empty when to believe it."""
    if found.ci95[1] - found.ci95[0] >= abs(found.offset - lag):
        return "that is no more precise than it is large"
    timing = np.array([found.offset] if found.drift is None else [found.offset, 1e-6 * found.drift.ppm])
    model = regression(pairs_of(log, found.observed, found.reference), timing[:1])
    shifted, plain = (np.nan, np.nan) if model is None else model.misfits([timing, np.array([lag])])
    if not shifted <= MAX_MISFIT * plain:
        return f"a lag of {1e3 * lag:.0f} ms fits the motion nearly as well, as with hysteresis or too few reaches"
    return ""


def seconds_of(text: str) -> float:
    """Seconds that an option states.

    Parameters
    ----------
    text : str, a finite number

    Raises
    ------
    DataError
        It is none.
    """
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        hint = "Commands know motion too: all that the motion says, drift included."
        raise DataError(f"the time offset is auto, none, or a number of seconds; got {text!r}.", hint=hint)
    return seconds


def align(
    log: CalibrationLog, offset: TimeOffset | float, *, signals: Sequence[str] = ("tracker_cp",)
) -> CalibrationLog:
    """Return the log with signal(t + d) in place of signal(t), for the signals of the other clock.

    Positions and joints are interpolated linearly, rotations along the shortest arc, as far as
    the clock ran on and never across a gap.

    Parameters
    ----------
    log : CalibrationLog, not changed
    offset : TimeOffset or float
        Seconds d by which the stamps of these signals run ahead; an estimate brings its drift along.
    signals : sequence of str
        Those that the other clock stamped; add external_jp where its joints come from the same tracker.

    Returns
    -------
    CalibrationLog
        Same rows; NaN where no sample of the other clock is near enough in time, as at one end of the recording.

    Raises
    ------
    DegenerateError
        The estimate says that the offset is not observable.
    LogError
        The log has no such signal, or no clock.
    """
    if log.static:
        raise LogError(
            "static poses have no clock to shift.", hint="Leave the time offset out (--time-offset).", path=log.name
        )
    if isinstance(offset, TimeOffset) and not offset.observable:
        hint = "Give its seconds if they are known from elsewhere, 0 if the clocks agree: --time-offset SECONDS."
        raise DegenerateError(f"the time offset is not observable: {offset.reason}", hint=hint)
    at = log.time + (offset.at(log.time) if isinstance(offset, TimeOffset) else offset)
    for name in signals:
        if name not in (*log.POSES, *log.JOINTS) or name not in log.signals:
            raise LogError(f"cannot align {name}: the log has {', '.join(log.signals)}.", hint="Name a motion signal.")
    moved: dict[str, Any] = {name: _resampled(log, name, at) for name in signals}
    return replace(log, **moved)


def _resampled(log: CalibrationLog, name: str, at: FloatArray) -> PoseSignal | FloatArray:
    values: PoseSignal | FloatArray = getattr(log, name)
    moved = np.full((values.table if isinstance(values, PoseSignal) else values).shape, np.nan)
    for rows in clock_runs(log):
        piece = interpolate(Stream(name, log.time[rows], values[rows]), at[rows])
        moved[rows] = piece.table if isinstance(piece, PoseSignal) else piece
    return PoseSignal.of(moved) if isinstance(values, PoseSignal) else moved
