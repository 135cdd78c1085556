"""Checks of a log: each one function that asks one question, entered into `CHECKS` by its decorator."""

from __future__ import annotations

from gpcorrect.logs.checks import clock, geometry, one_joint, rows, signals, units
from gpcorrect.logs.checks.evidence import CHECKS, Check, Evidence, Finding, Severity

__all__ = [
    "CHECKS",
    "Check",
    "Evidence",
    "Finding",
    "Severity",
    "clock",
    "geometry",
    "one_joint",
    "rows",
    "signals",
    "units",
]
