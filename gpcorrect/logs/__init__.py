"""Recordings in: one reader a format, all yield a CalibrationLog."""

from __future__ import annotations

from gpcorrect.logs.combine import combine
from gpcorrect.logs.join import join_logs
from gpcorrect.logs.reader import read_log
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.writer import write_log

__all__ = ["Stream", "combine", "interpolate", "join_logs", "read_log", "write_log"]
