"""Exports of motion capture systems: each reader yields a Take, and a Take becomes a log."""

from __future__ import annotations

from gpcorrect.logs.mocap import motive, trc, vicon
from gpcorrect.logs.mocap.take import Take, log_of

__all__ = ["Take", "log_of", "motive", "trc", "vicon"]
