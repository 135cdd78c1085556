"""The outside encoders' clock against the robot's."""

from __future__ import annotations

from gpcorrect.logs.sync import match_clocks
from gpcorrect.types import CalibrationLog

__all__ = ["joints_on_one_clock"]


def joints_on_one_clock(log: CalibrationLog, mode: str, input_signal: str) -> CalibrationLog:
    """Return the log with `external_jp` on the robot's clock; one that lacks a signal as it is."""
    if log.external_jp is None or getattr(log, input_signal) is None:
        return log
    return match_clocks(log, "external_jp", input_signal, mode)[0]
