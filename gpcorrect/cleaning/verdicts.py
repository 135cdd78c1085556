"""The verdict on each sample while the rules are asked one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gpcorrect.cleaning.reasons import Reason
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

__all__ = ["ReasonArray", "Verdicts"]

ReasonArray = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class Verdicts:
    """Why each of n samples is rejected, empty while it is kept, with the value measured and the limit that it broke.

    Parameters
    ----------
    reason : (n,) array of str
        Codes of :class:`Reason`.
    value, limit : (n,) arrays
        In the reason's unit; NaN while kept and where nothing is measured.
    """

    reason: ReasonArray
    value: FloatArray
    limit: FloatArray

    @classmethod
    def none(cls, n: int) -> Self:
        """Nothing is rejected yet."""
        nothing = np.full(n, np.nan)
        return cls(frozen_array(np.full(n, ""), np.str_), frozen_array(nothing), frozen_array(nothing))

    @property
    def keep(self) -> BoolArray:
        """(n,) mask of samples that no rule has rejected."""
        keep: BoolArray = self.reason == ""
        return keep

    def replaced(self, rows: IntArray, found: Verdicts) -> Self:
        """Verdicts in which those on `rows` are the ones found."""
        reason = self.reason.astype(np.result_type(self.reason, found.reason))
        value, limit = np.array(self.value), np.array(self.limit)
        reason[rows], value[rows], limit[rows] = found.reason, found.value, found.limit
        return type(self)(frozen_array(reason, np.str_), frozen_array(value), frozen_array(limit))

    def rejecting(self, mask: BoolArray, reason: Reason, value: FloatArray | float, limit: FloatArray | float) -> Self:
        """Verdicts in which the samples of `mask` that were kept so far are rejected."""
        new = mask & self.keep
        return type(self)(
            frozen_array(np.where(new, reason.value, self.reason), np.str_),
            frozen_array(np.where(new, value, self.value)),
            frozen_array(np.where(new, limit, self.limit)),
        )
