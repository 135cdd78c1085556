"""Segments that a person keeps or drops whatever the rules say."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, CalibrationLog

__all__ = ["Segment", "require_segments", "segment_mask"]


@dataclass(frozen=True)
class Segment:
    """A stretch of one trajectory, both ends included.

    Parameters
    ----------
    trajectory : int
        Which motion.
    start, stop : float
        First and last time, s; infinite for an open end.

    Raises
    ------
    DataError
        `stop` comes before `start`.
    """

    trajectory: int
    start: float = -np.inf
    stop: float = np.inf

    def __post_init__(self) -> None:
        if not self.start <= self.stop:
            raise DataError(
                f"a segment runs forward in time, got {self.start} s to {self.stop} s.",
                hint="Give trajectory, start and stop, in seconds of the log's clock.",
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the segment as JSON-able values, None for an open end."""
        start, stop = (value if np.isfinite(value) else None for value in (self.start, self.stop))
        return {"trajectory": self.trajectory, "start": start, "stop": stop}


def require_segments(log: CalibrationLog, segments: Iterable[Segment]) -> None:
    """Refuse segments that no sample of the log lies in: a person meant something by them.

    Raises
    ------
    DataError
        There is no such trajectory, or it has no sample at these times.
    """
    for segment in segments:
        rows = log.trajectory == segment.trajectory
        if not rows.any():
            ids = log.trajectory_ids
            raise DataError(
                f"a segment names trajectory {segment.trajectory}, which is not in the log.",
                hint=f"It has {len(ids)}, numbered from {ids.min()} to {ids.max()}.",
            )
        if not segment_mask(log, [segment]).any():
            low, high = log.time[rows].min(), log.time[rows].max()
            raise DataError(
                f"trajectory {segment.trajectory} has no sample from {segment.start:g} to {segment.stop:g} s.",
                hint=f"That trajectory runs from {low:g} s to {high:g} s of the log's clock.",
            )


def segment_mask(log: CalibrationLog, segments: Iterable[Segment]) -> BoolArray:
    """(n,) mask of the samples of `log` that lie in any of the segments."""
    mask = np.zeros(len(log), dtype=bool)
    for segment in segments:
        mask |= (log.trajectory == segment.trajectory) & (log.time >= segment.start) & (log.time <= segment.stop)
    return mask
