"""Recordings in: one reader a format, all yield a CalibrationLog; clocks and the dry run."""

from __future__ import annotations

from gpcorrect.logs.join import join_logs, with_tracker
from gpcorrect.logs.reader import read_log
from gpcorrect.logs.streams import Stream, combine, interpolate
from gpcorrect.logs.sync import Clocks, TimeOffset, align, log_offset, match_clocks
from gpcorrect.logs.validate import ValidationReport, refuse_misread, validate_log
from gpcorrect.logs.writer import write_log

__all__ = [
    "Clocks",
    "Stream",
    "TimeOffset",
    "ValidationReport",
    "align",
    "combine",
    "interpolate",
    "join_logs",
    "log_offset",
    "match_clocks",
    "read_log",
    "refuse_misread",
    "validate_log",
    "with_tracker",
    "write_log",
]
