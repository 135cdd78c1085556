"""Clocks: how far the stamps of two recordings of one motion differ, and a log put on one clock."""

from __future__ import annotations

from gpcorrect.logs.sync.clocks import NAMES, Clocks, align, match_clocks, seconds_of, shifted_by_motion
from gpcorrect.logs.sync.estimate import TimeOffset, estimate_offset, log_offset, rough_offsets, stream_offset
from gpcorrect.logs.sync.motion import REFERENCES, Motion, MotionPair

__all__ = [
    "NAMES",
    "REFERENCES",
    "Clocks",
    "Motion",
    "MotionPair",
    "TimeOffset",
    "align",
    "estimate_offset",
    "log_offset",
    "match_clocks",
    "rough_offsets",
    "seconds_of",
    "shifted_by_motion",
    "stream_offset",
]
