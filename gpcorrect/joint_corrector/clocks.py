"""Are the outside encoders on another clock than the robot? The log part says; a servo's own lag is left alone."""

from __future__ import annotations

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.logs import align, log_offset
from gpcorrect.types import CalibrationLog

__all__ = ["joints_on_one_clock"]

PLAUSIBLE_LAG = (-0.02, 0.15)  # s: what filters and servo explain; an estimate from uneven joints is no finer


def joints_on_one_clock(log: CalibrationLog, mode: str, input_signal: str) -> CalibrationLog:
    """Return the log with `external_jp` on the robot's clock.

    Parameters
    ----------
    log : CalibrationLog
        With both signals; a log that lacks one is returned as it is.
    mode : str
        "none", "auto", or seconds by which the outside encoders run behind. "auto" shifts only what no servo explains.
    input_signal : str
        The robot's signal.

    Raises
    ------
    DataError
        `mode` is none of these.
    """
    if mode == "none" or log.external_jp is None or getattr(log, input_signal) is None:
        return log
    if mode != "auto":
        try:
            return align(log, float(mode), signals=("external_jp",))
        except ValueError as error:
            raise DataError(f"the time offset is auto, none, or a number of seconds; got {mode!r}.") from error
    found = log_offset(log, "external_jp", input_signal)
    low, high = found.ci95
    step = float(np.median(np.diff(log.time))) if len(log) > 1 else 0.0  # below it, slack looks like a lag
    if not found.observable or (PLAUSIBLE_LAG[0] - step <= high and low <= PLAUSIBLE_LAG[1] + step):
        return log
    return align(log, found, signals=("external_jp",))
