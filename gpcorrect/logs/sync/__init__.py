"""Clocks: how far the stamps of two recordings of one motion differ, and a log put on one clock."""

from __future__ import annotations

from gpcorrect.logs.sync.clocks import PLAUSIBLE_LAG, Clocks, align, match_clocks, seconds_of
from gpcorrect.logs.sync.estimate import estimate_offset, log_offset, stream_offset
from gpcorrect.logs.sync.motion import REFERENCES, Motion, MotionPair, pairs_of
from gpcorrect.logs.sync.offset import ClockDrift, TimeOffset

__all__ = [
    "PLAUSIBLE_LAG",
    "REFERENCES",
    "ClockDrift",
    "Clocks",
    "Motion",
    "MotionPair",
    "TimeOffset",
    "align",
    "estimate_offset",
    "log_offset",
    "match_clocks",
    "pairs_of",
    "seconds_of",
    "stream_offset",
]
