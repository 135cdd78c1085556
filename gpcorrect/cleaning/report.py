"""What cleaning says of each sample: why it is rejected, what was measured, and the limit that it broke."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

ReasonArray = NDArray[np.str_]


class Reason(StrEnum):
    """Code of a rejection; :attr:`sentence` says it in words, :attr:`unit` is that of value and limit.

    Codes are listed in the order in which the rules are applied: a sample carries the first that it breaks.
    """

    INVALID = "invalid"
    WORKSPACE = "workspace"
    ROTATION = "rotation"
    FROZEN = "frozen"
    OUTLIER = "outlier"
    SPEED = "speed"
    ANGULAR_SPEED = "angular_speed"
    JUMP = "jump"
    OFFSET = "offset"
    SURROUNDED = "surrounded"
    TRAJECTORY = "trajectory"
    MANUAL = "manual"

    @property
    def sentence(self) -> str:
        """What happened, for a reader of the report."""
        return _MEANING[self][0]

    @property
    def unit(self) -> str:
        """Unit of the measured value and of the limit that it broke."""
        return _MEANING[self][1]


_MEANING = {
    Reason.INVALID: ("a number is missing, or the norm of a quaternion is not 1.", "bad numbers"),
    Reason.WORKSPACE: ("the observed position lies outside the commanded workspace and its margin.", "m"),
    Reason.ROTATION: ("the observation is turned from the command by more than the arm can err.", "rad"),
    Reason.FROZEN: ("the observation stood still while the command travelled.", "m"),
    Reason.OUTLIER: ("the sample lies too many robust scales away from the registration.", "robust scales"),
    Reason.SPEED: ("the sample lies between position steps that the arm is too slow for.", "m/s"),
    Reason.ANGULAR_SPEED: ("the sample lies between rotation steps that the arm is too slow for.", "rad/s"),
    Reason.JUMP: (
        "the error jumps on entering or leaving the sample's piece, by more than noise and motion explain.",
        "times the largest plausible step",
    ),
    Reason.OFFSET: (
        "the error differs from what positions and velocities like this one show elsewhere in the recording.",
        "robust scales",
    ),
    Reason.SURROUNDED: (
        "most samples right before and after it were rejected, so it is no part of a motion.",
        "share rejected",
    ),
    Reason.TRAJECTORY: ("nearly all samples of its trajectory were rejected, so the whole of it is.", "share rejected"),
    Reason.MANUAL: ("a segment dropped by hand.", ""),
}


@dataclass(frozen=True, eq=False)
class Labels:
    """Why each of n samples is rejected, with the value measured and the limit that it broke."""

    reason: ReasonArray  # (n,) codes of :class:`Reason`, empty for samples that pass
    # (n,) each: in the reason's unit; NaN for samples that pass and where nothing is measured
    value: FloatArray
    limit: FloatArray

    @classmethod
    def passing(cls, n: int) -> Self:
        """Labels of n samples that all pass.

        Parameters
        ----------
        n : int
        """
        nothing = np.full(n, np.nan)
        return cls(frozen_array(np.full(n, ""), np.str_), frozen_array(nothing), frozen_array(nothing))

    @property
    def keep(self) -> BoolArray:
        """(n,) mask of samples that no rule has rejected."""
        return np.asarray(self.reason == "")

    def replaced(self, rows: IntArray, found: Labels) -> Self:
        """Labels in which those of `rows` are the ones that were found.

        Parameters
        ----------
        rows : (m,) array, row numbers
        found : Labels, m of them
        """
        reason = self.reason.astype(np.result_type(self.reason, found.reason))
        value, limit = np.array(self.value), np.array(self.limit)
        reason[rows], value[rows], limit[rows] = found.reason, found.value, found.limit
        return type(self)(frozen_array(reason, np.str_), frozen_array(value), frozen_array(limit))

    def rejecting(self, mask: BoolArray, reason: Reason, value: FloatArray | float, limit: FloatArray | float) -> Self:
        """Labels in which those samples of `mask` are rejected that passed so far.

        Parameters
        ----------
        mask : (n,) bool array
        reason : Reason
        value, limit : (n,) arrays or float, what was measured and what it exceeds
        """
        new = mask & self.keep
        return type(self)(
            frozen_array(np.where(new, reason.value, self.reason), np.str_),
            frozen_array(np.where(new, value, self.value)),
            frozen_array(np.where(new, limit, self.limit)),
        )

    def rejecting_above(self, value: FloatArray, reason: Reason, limit: float) -> Self:
        """Labels in which the samples whose value exceeds the limit are rejected.

        Parameters
        ----------
        value : (n,) array
        reason : Reason
        limit : float
        """
        return self.rejecting(value > limit, reason, value, limit)


@dataclass(frozen=True, eq=False)
class CleaningReport:
    """Which samples of a log pass, and why the others do not.

    Parameters
    ----------
    time, trajectory : (n,) arrays, the log's
    reason, value, limit : (n,) arrays, see :class:`Labels`
    overruled : (n,) array of str, what the rules would have said of samples that pass by hand; empty elsewhere
    """

    time: FloatArray
    trajectory: IntArray
    reason: ReasonArray
    value: FloatArray
    limit: FloatArray
    overruled: ReasonArray

    def __len__(self) -> int:
        return len(self.time)

    @property
    def keep(self) -> BoolArray:
        """(n,) mask of samples that pass."""
        return np.asarray(self.reason == "")

    @property
    def counts(self) -> dict[str, int]:
        """Rejected samples by reason, only reasons that occur, in the order of :class:`Reason`."""
        found = {reason.value: int(np.count_nonzero(self.reason == reason.value)) for reason in Reason}
        return {code: count for code, count in found.items() if count}

    def to_table(self) -> list[dict[str, Any]]:
        """Return a row for each sample that is rejected or forced by hand: what was measured and the limit it broke."""
        return [self._row(int(row)) for row in np.flatnonzero(~self.keep | (self.overruled != ""))]

    def _row(self, row: int) -> dict[str, Any]:
        code = str(self.reason[row] or self.overruled[row])
        measured = {"value": float(self.value[row]), "limit": float(self.limit[row])}
        return {
            "row": row,
            "time": float(self.time[row]),
            "trajectory": int(self.trajectory[row]),
            "reason": code,
            **{name: number if np.isfinite(number) else None for name, number in measured.items()},  # JSON has no NaN
            "unit": Reason(code).unit,
            "kept_by_hand": bool(self.reason[row] == ""),
        }
