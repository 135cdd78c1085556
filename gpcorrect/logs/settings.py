"""How to read: what the caller said, in one object that every format's reader takes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ColumnMap
from gpcorrect.logs.order import Disorder

__all__ = ["DEFAULT_MAX_BYTES", "ReadSettings", "check_size"]

DEFAULT_MAX_BYTES = 2 * 1024**3
"""Largest table that is read into memory unless the caller allows more."""


@dataclass(frozen=True)
class ReadSettings:
    """What the caller said about a recording.

    Parameters
    ----------
    columns : ColumnMap
        The mapping; empty when none was given.
    mapped : bool
        Whether a mapping was given.
    disorder : {"refuse", "drop", "keep"}
        What to do about time that does not increase.
    max_bytes : int
        Largest table to read into memory.
    """

    columns: ColumnMap = field(default_factory=ColumnMap)
    mapped: bool = False
    disorder: Disorder = "refuse"
    max_bytes: int = DEFAULT_MAX_BYTES


def check_size(path: Path, max_bytes: int) -> None:
    """Refuse a table that would not fit in memory.

    Raises
    ------
    LogError
        The file is larger than `max_bytes`, or empty.
    """
    size = path.stat().st_size
    if size > max_bytes:
        hint = "Convert it to Parquet, split it, or raise the limit with max_bytes."
        raise LogError(f"expected at most {max_bytes / 1e9:.3g} GB, got {size / 1e9:.3g} GB.", hint=hint)
    if size == 0:
        raise LogError("the file is empty.")
