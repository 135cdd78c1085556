"""What a planner gets back: the answer, and which model and process gave it."""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np

from gpcorrect.correction import Correction, Reason
from gpcorrect.types import FloatArray
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import ReplyMeta


class Reply(msgspec.Struct, frozen=True, eq=False):
    """The answer to one question, about one pose or n rows.

    Parameters
    ----------
    answer : Correction
        In a fallback the registered pose or the reported joints themselves, with unknown (NaN) uncertainty.
    meta : ReplyMeta, which model and process answered; empty in a fallback
    failure : ServiceError or None, why no server answered, in a fallback
    """

    answer: Correction
    meta: ReplyMeta = ReplyMeta()
    failure: ServiceError | None = None

    @property
    def position(self) -> FloatArray:
        """Command (3,) or (n, 3), base frame, m."""
        assert self.answer.position is not None, "this reply holds joints"
        return self.answer.position

    @property
    def quaternion(self) -> FloatArray | None:
        """Command (4,) or (n, 4) wxyz; None when none was asked for."""
        return self.answer.quaternion

    @property
    def pose(self) -> FloatArray:
        """The command as (7,) or (n, 7) x y z qw qx qy qz, or (3,) or (n, 3)."""
        quaternion = self.quaternion
        return self.position if quaternion is None else np.concatenate([self.position, quaternion], axis=-1)

    @property
    def joints(self) -> FloatArray:
        """Joints (n, d), rad or m; NaN where a number was missing."""
        assert self.answer.joints is not None, "this reply holds poses"
        return self.answer.joints

    @property
    def std(self) -> FloatArray:
        """Standard deviations: m, then rad; NaN where not learned."""
        return self.answer.std

    @property
    def interval95(self) -> FloatArray:
        """Half widths of the 95 % intervals, as :attr:`std`."""
        return self.answer.interval95

    @property
    def in_domain(self) -> Any:
        """Whether the query lies near training data: bool, or (n,) bool array; false in a fallback."""
        return self.answer.in_domain

    @property
    def status(self) -> Any:
        """OK, EXTRAPOLATING, LIMITED or MISSING, in a fallback the failure; a tuple of n of them for n rows."""
        return self.answer.status if self.failure is None else self._repeated(self.failure.status)

    @property
    def reason(self) -> Any:
        """Why the status is not OK, or what was not used; a tuple of n texts for n rows."""
        return self.answer.reason if self.failure is None else self._repeated(self.failure.message)

    @property
    def fallback(self) -> Literal["", "identity"]:
        """Whether nothing learned is in this answer because no server corrected it ("identity")."""
        return "" if self.failure is None else "identity"

    def _repeated(self, text: str) -> Any:
        return (text,) * len(self.answer) if isinstance(self.answer.reasons, np.ndarray) else text


def uncorrected(rows: FloatArray, failure: ServiceError, *, joints: bool = False) -> Reply:
    """Return poses in the frame of commands, or joints, as an answer that nobody corrected, with the failure.

    Parameters
    ----------
    rows : (7,), (3,), (n, 7) or (n, 3) array, or (n, d) joints, what registration alone commands; joints as they are
    failure : ServiceError
    joints : bool
    """
    unknown = np.full(rows.shape if joints else (*rows.shape[:-1], 6), np.nan)
    outside: Any = Reason.OUTSIDE if rows.ndim == 1 else np.full(len(rows), int(Reason.OUTSIDE))
    if joints:
        return Reply(Correction(None, None, rows, unknown, unknown, outside), failure=failure)
    quaternion = rows[..., 3:] if rows.shape[-1] > 3 else None
    return Reply(Correction(rows[..., :3], quaternion, None, unknown, unknown, outside), failure=failure)
