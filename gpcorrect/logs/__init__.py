"""Recordings in: one reader a format, all yield a CalibrationLog; clocks and the dry run."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpcorrect.logs.join import join_logs, with_tracker
    from gpcorrect.logs.reader import read_log
    from gpcorrect.logs.streams import Stream, combine, interpolate
    from gpcorrect.logs.sync import Clocks, TimeOffset, align, log_offset, match_clocks
    from gpcorrect.logs.validate import ValidationReport, refuse_misread, validate_log
    from gpcorrect.logs.writer import require_writable, write_log

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
    "require_writable",
    "validate_log",
    "with_tracker",
    "write_log",
]

_PLACES = {
    "Clocks": "sync",
    "Stream": "streams",
    "TimeOffset": "sync",
    "ValidationReport": "validate",
    "align": "sync",
    "combine": "streams",
    "interpolate": "streams",
    "join_logs": "join",
    "log_offset": "sync",
    "match_clocks": "sync",
    "read_log": "reader",
    "refuse_misread": "validate",
    "require_writable": "writer",
    "validate_log": "validate",
    "with_tracker": "join",
    "write_log": "writer",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: reading needs no statistics, filters or kinematics."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
