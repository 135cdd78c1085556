"""What a check says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gpcorrect.types import IntArray

__all__ = ["Finding", "Severity", "examples"]

Severity = Literal["error", "warning", "info"]

EXAMPLES = 5


@dataclass(frozen=True)
class Finding:
    """One thing that a check has to say.

    Parameters
    ----------
    severity : {"error", "warning", "info"}
        error: what is learned from this log will be wrong; warning: look at it first; info: good to know.
    code : str
        Short fixed name, for programs.
    signal : str
        Name of the log's signal, "time" or "trajectory"; empty when it is about the log as a whole.
    message : str
        What was found, with numbers and units.
    hint : str
        What to do about it.
    count : int
        Samples (or trajectories) it is about.
    rows : tuple of int
        The first of them: rows of the log counted from 0, or trajectory numbers when the signal is
        "trajectory".
    """

    severity: Severity
    code: str
    signal: str
    message: str
    hint: str = ""
    count: int = 0
    rows: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form."""
        return {
            "severity": self.severity,
            "code": self.code,
            "signal": self.signal,
            "message": self.message,
            "hint": self.hint,
            "count": self.count,
            "rows": list(self.rows),
        }


def examples(rows: Sequence[int] | IntArray) -> tuple[int, ...]:
    """Return the first few rows as plain integers."""
    return tuple(int(r) for r in rows[:EXAMPLES])
