"""What cleaning did, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.verdicts import ReasonArray
from gpcorrect.types import BoolArray, FloatArray, IntArray
from gpcorrect.velocity import segment_labels

__all__ = ["CleaningReport"]


@dataclass(frozen=True, eq=False)
class CleaningReport:
    """Which samples of a log are kept, and why the others are not.

    Parameters
    ----------
    time, trajectory : (n,) arrays
        The log's.
    reason : (n,) array of str
        Code of :class:`~gpcorrect.cleaning.Reason` of each sample, empty where it is kept.
    value, limit : (n,) arrays
        What was measured and the limit that it broke, in the reason's unit; NaN where there is none.
    overruled : (n,) array of str
        What the rules would have said of samples that are kept by hand; empty elsewhere.
    dropped_trajectories : dict of int to float
        Share of rejected samples of each trajectory that was dropped whole.
    settings : CleaningSettings
        As used.
    scales : (parts,) array
        Robust standard deviation of an error component about the rigid model, m and rad.
    rigid : object
        The rigid map.
    """

    time: FloatArray
    trajectory: IntArray
    reason: ReasonArray
    value: FloatArray
    limit: FloatArray
    overruled: ReasonArray
    dropped_trajectories: dict[int, float]
    settings: CleaningSettings
    scales: FloatArray
    rigid: Any

    def __len__(self) -> int:
        return len(self.time)

    @property
    def keep(self) -> BoolArray:
        """(n,) mask of kept samples."""
        keep: BoolArray = self.reason == ""
        return keep

    @property
    def counts(self) -> dict[str, int]:
        """Rejected samples by reason, only reasons that occur, in the order of :class:`Reason`."""
        found = {reason.value: int(np.count_nonzero(self.reason == reason.value)) for reason in Reason}
        return {code: count for code, count in found.items() if count}

    def segment_labels(self, max_gap: float | None = None) -> IntArray:
        """Unbroken runs (n,) of kept samples, -1 where rejected: velocities are computed inside them only."""
        return segment_labels(self.time, self.trajectory, self.keep, max_gap)

    def to_dict(self) -> dict[str, Any]:
        """Return the summary as JSON-able values; the samples are in :meth:`to_table`."""
        return {
            "samples": len(self),
            "kept": int(self.keep.sum()),
            "counts": self.counts,
            "meaning": {code: Reason(code).sentence for code in self.counts},
            "dropped_trajectories": {str(k): share for k, share in self.dropped_trajectories.items()},
            "kept_by_hand": int(np.count_nonzero(self.keep & (self.overruled != ""))),
            "dropped_by_hand": self.counts.get(Reason.MANUAL.value, 0),
            "settings": self.settings.to_dict(),
            "scales": self.scales.tolist(),
            "rigid": self.rigid.to_dict() if hasattr(self.rigid, "to_dict") else str(self.rigid),
        }

    def to_table(self) -> list[dict[str, Any]]:
        """Return a row for each sample that is rejected or kept by hand: what was measured and the limit it broke."""
        rows = np.flatnonzero(~self.keep | (self.overruled != ""))
        return [self._row(int(row)) for row in rows]

    def _row(self, row: int) -> dict[str, Any]:
        code = str(self.reason[row] or self.overruled[row])
        return {
            "row": row,
            "time": float(self.time[row]),
            "trajectory": int(self.trajectory[row]),
            "reason": code,
            "value": _number(self.value[row]),
            "limit": _number(self.limit[row]),
            "unit": Reason(code).unit,
            "kept_by_hand": bool(self.reason[row] == ""),
        }


def _number(value: float) -> float | None:
    """JSON has no NaN: None where nothing was measured."""
    return float(value) if np.isfinite(value) else None
