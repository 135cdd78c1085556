"""Recordings in: one reader a format, all yield a CalibrationLog; clocks and the dry run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpcorrect.lazy import imported_on_demand

if TYPE_CHECKING:
    from gpcorrect.logs.join import join_logs, refuse_twice, with_tracker
    from gpcorrect.logs.native import require_writable, write_log
    from gpcorrect.logs.reader import read_log
    from gpcorrect.logs.streams import Stream, combine, interpolate
    from gpcorrect.logs.sync import Clocks, TimeOffset, align, log_offset, match_clocks
    from gpcorrect.logs.validate import ValidationReport, refuse_misread, validate_log

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
    "refuse_twice",
    "require_writable",
    "validate_log",
    "with_tracker",
    "write_log",
]

__getattr__ = imported_on_demand(
    __name__,
    {
        "join": "join_logs refuse_twice with_tracker",
        "reader": "read_log",
        "streams": "Stream combine interpolate",
        "sync": "Clocks TimeOffset align log_offset match_clocks",
        "validate": "ValidationReport refuse_misread validate_log",
        "native": "require_writable write_log",
    },
)
