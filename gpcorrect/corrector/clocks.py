"""Is the tracker on another clock than the commands? Motion tells that from a robot's lag only by its size."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.errors import DataError
from gpcorrect.logs import TimeOffset, align, log_offset
from gpcorrect.types import CalibrationLog

__all__ = ["PLAUSIBLE_LAG", "Clocks", "on_one_clock", "seconds_of"]

# s: a servo follows its command within this time and never runs ahead of it; recorded: 13 to 47 ms on a dVRK.
PLAUSIBLE_LAG = (0.0, 0.15)


@dataclass(frozen=True, eq=False)
class Clocks:
    """What was found of the tracker's clock, and what was done about it.

    Parameters
    ----------
    offset : TimeOffset or None
        Estimate of how far the tracker's stamps run ahead; None when nobody looked.
    applied : float
        Seconds by which the tracker was shifted; 0 when it was left alone.
    remark : str
        The same in a sentence.
    """

    offset: TimeOffset | None
    applied: float
    remark: str


def on_one_clock(log: CalibrationLog, mode: str) -> tuple[CalibrationLog, Clocks]:
    """Return the log with the tracker on the commands' clock, as `mode` says.

    Parameters
    ----------
    log : CalibrationLog
        Holds `tracker_cp` and `setpoint_cp`.
    mode : str
        "none" leaves the stamps alone. A number of seconds shifts the tracker by it. "auto" estimates the offset and
        shifts only what cannot be the robot's own lag (the tracker ahead of its command, or more than 0.15 s
        behind): a lag is part of
        how the robot misses, and the velocity features learn it.

    Raises
    ------
    LogError
        The log lacks one of the two signals.
    DataError
        `mode` is none of these.
    """
    pose_pair(log)  # says which signal is missing before anything is computed
    if mode == "none":
        return log, Clocks(None, 0.0, "the stamps of the tracker were taken as they are")
    if mode != "auto":
        seconds = seconds_of(mode)
        return align(log, seconds), Clocks(
            None, seconds, f"the tracker was shifted by the {seconds:g} s that were given"
        )
    found = log_offset(log, "tracker_cp", "setpoint_cp")
    if not found.observable:
        return log, Clocks(found, 0.0, f"the time offset of the tracker is not observable: {found.reason}")
    middle, low, high = (1e3 * seconds for seconds in (found.offset, *found.ci95))
    size = f"the tracker runs {middle:.1f} ms behind the commands (95 %: {low:.1f} to {high:.1f})"
    step = _sample_step(log)
    if PLAUSIBLE_LAG[0] - step <= found.ci95[1] and found.ci95[0] <= PLAUSIBLE_LAG[1] + step:
        return log, Clocks(found, 0.0, f"{size}, as a servo may: left to the velocity features")
    return align(log, found), Clocks(found, found.offset, f"{size}, more than a servo does: the tracker was shifted")


def _sample_step(log: CalibrationLog) -> float:
    """Median time between samples of a trajectory, s: an offset below it is not worth an interpolation."""
    inside = np.diff(log.trajectory) == 0
    return float(np.median(np.diff(log.time)[inside])) if inside.any() else 0.0


def seconds_of(text: str) -> float:
    """Seconds that an option states.

    Raises
    ------
    DataError
        It is no finite number.
    """
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise DataError(f"the time offset is auto, none, or a number of seconds; got {text!r}.")
    return seconds
