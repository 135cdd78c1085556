"""The one answer of every task, from the model to the wire: poses, joints or tool positions, one or n of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntFlag, StrEnum
from typing import Any, Self

import numpy as np

from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal


class Status(StrEnum):
    """How far an answer can be used."""

    OK = "OK"
    EXTRAPOLATING = "EXTRAPOLATING"
    LIMITED = "LIMITED"
    MISSING = "MISSING"
    STALE = "STALE"


class Reason(IntFlag):
    """What acted on an answer, or was not used for it; several may hold at once."""

    NONE = 0
    LIMITED = 1
    OUTSIDE = 2
    BRIDGED = 4
    RATE_LIMITED = 8
    AT_REST = 16
    JUST_BEGUN = 32
    NO_HISTORY = 64
    MISSING = 128
    STALE = 256
    BOUNDED = 512

    @property
    def status(self) -> Status:
        """The gravest status that these reasons bring."""
        for reasons, status in _STATUS:
            if self & reasons:
                return status
        return Status.OK

    @property
    def text(self) -> str:
        """The reasons in words; empty for none."""
        return "; ".join(text for reason, text in _TEXT.items() if self & reason)


_STATUS = (
    (Reason.MISSING, Status.MISSING),
    (Reason.STALE, Status.STALE),
    (Reason.LIMITED | Reason.BRIDGED | Reason.RATE_LIMITED | Reason.BOUNDED, Status.LIMITED),
    (Reason.OUTSIDE, Status.EXTRAPOLATING),
)
_TEXT = {
    Reason.MISSING: "a number that the model needs is missing",
    Reason.STALE: "the sample waited too long",
    Reason.BOUNDED: "cut to the bound that this server's operator set",
    Reason.RATE_LIMITED: "the bound on how fast a correction may change acted",
    Reason.BRIDGED: "the path jumps here faster than the arm can move: bridged by straight motion",
    Reason.LIMITED: "the learned part was cut to the largest one that training justifies",
    Reason.OUTSIDE: "outside the training region: nothing is known of how the robot misses there",
    Reason.AT_REST: "no twist was given: taken as at rest",
    Reason.JUST_BEGUN: "the stream has just begun: taken as at rest",
    Reason.NO_HISTORY: "no history was given: memory features were not used",
}


_ARRAYS = ("position", "quaternion", "joints", "std", "interval95")


@dataclass(frozen=True, eq=False, slots=True)
class Correction:
    """What to command, or where the robot is, and how sure that is; arrays of n answers have a leading axis n.

    Parameters
    ----------
    position : (3,) or (n, 3) array or None
        Base frame, m; None where the answer is joints.
    quaternion : (4,) or (n, 4) array or None
        Orientation wxyz; None when no orientation was asked for.
    joints : (d,) or (n, d) array or None
        rad or m; None where the answer is a pose.
    std : (k,) or (n, k) array
        Standard deviation of each component: x, y, z in m and the rotation vector in rad (k = 6), joints (k = d), or
        x, y, z (k = 3); NaN where not learned or not known.
    interval95 : (k,) or (n, k) array
        Half width of the calibrated 95 % interval, same units.
    reasons : Reason or (n,) int array
        What acted on the answer; `Reason.NONE` is 0.
    """

    position: FloatArray | None
    quaternion: FloatArray | None
    joints: FloatArray | None
    std: FloatArray
    interval95: FloatArray
    reasons: Reason | IntArray

    @property
    def poses(self) -> PoseSignal:
        """Poses of n answers that are no joints."""
        assert self.position is not None
        return PoseSignal(self.position, self.quaternion)

    @property
    def in_domain(self) -> Any:
        """Whether the query lies near training data: bool, or (n,) bool array."""
        outside = self.reasons & (Reason.OUTSIDE | Reason.MISSING)
        return outside == 0

    @property
    def status(self) -> Any:
        """:class:`Status`, or a tuple of n of them."""
        if isinstance(self.reasons, np.ndarray):
            return tuple(Reason(code).status for code in self.reasons.tolist())
        return self.reasons.status

    @property
    def reason(self) -> Any:
        """Why the status is not OK, or what was not used, in words: text, or a tuple of n texts; empty for nothing."""
        if isinstance(self.reasons, np.ndarray):
            return tuple(Reason(code).text for code in self.reasons.tolist())
        return self.reasons.text

    def __len__(self) -> int:
        """Return the number of answers; raises TypeError for a single one."""
        if not isinstance(self.reasons, np.ndarray):
            raise TypeError("a single answer has no length")
        return len(self.reasons)

    def __getitem__(self, row: int | BoolArray | IntArray) -> Self:
        """Return one answer of n, or several by their rows."""
        assert isinstance(self.reasons, np.ndarray)
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        parts: dict[str, Any] = {name: None if part is None else part[row] for name, part in arrays.items()}
        reasons = self.reasons[row]
        return type(self)(**parts, reasons=reasons if isinstance(reasons, np.ndarray) else Reason(int(reasons)))

    def because(self, reason: Reason, rows: BoolArray | bool = True) -> Self:
        """Return the same with a further reason, at these rows (n,) of n."""
        if not (rows if isinstance(rows, bool) else rows.any()):
            return self
        if isinstance(self.reasons, np.ndarray):
            return replace(self, reasons=np.where(rows, self.reasons | int(reason), self.reasons))
        return replace(self, reasons=self.reasons | reason)

    def at(self, rows: BoolArray, other: Correction) -> Self:
        """Return these answers at rows (n,) of n, and another's, of the same parts, elsewhere."""
        parts: dict[str, Any] = {}
        for name in _ARRAYS:
            mine, its = getattr(self, name), getattr(other, name)
            parts[name] = None if mine is None or its is None else np.where(rows[:, None], mine, its)
        return type(self)(**parts, reasons=np.where(rows, self.reasons, other.reasons))

    def numbers(self, width: FloatArray) -> FloatArray:
        """Return the poses of n answers beside how sure they are, `width` (n, k), whose NaN become 0."""
        parts = (self.position, self.quaternion, np.nan_to_num(width))
        return np.hstack([part for part in parts if part is not None])

    @classmethod
    def stack(cls, answers: Sequence[Correction]) -> Self:
        """Gather single answers, one at least, given one after the other."""
        columns = {name: [getattr(answer, name) for answer in answers] for name in _ARRAYS}
        parts: dict[str, Any] = {n: None if values[0] is None else np.array(values) for n, values in columns.items()}
        return cls(**parts, reasons=np.array([int(answer.reasons) for answer in answers], dtype=np.int64))
