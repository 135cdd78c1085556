"""The tracker's clock against the commands'."""

from __future__ import annotations

from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.logs.sync import Clocks, match_clocks, seconds_of
from gpcorrect.types import CalibrationLog

__all__ = ["Clocks", "on_one_clock", "seconds_of"]


def on_one_clock(log: CalibrationLog, mode: str) -> tuple[CalibrationLog, Clocks]:
    """Return the log with the tracker on the commands' clock; see :func:`gpcorrect.logs.sync.match_clocks`."""
    pose_pair(log)  # says which signal is missing before anything is computed
    return match_clocks(log, "tracker_cp", "setpoint_cp", mode)
