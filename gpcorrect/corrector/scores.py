"""How large errors are beside what the model promised, a number a trajectory: what ageing is measured by."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray, IntArray

__all__ = ["normalised", "scores_by_trajectory"]

Z95 = 1.959964


def normalised(errors: FloatArray, half_widths: FloatArray) -> FloatArray:
    """Root mean square over components `(n,)` of errors `(n, m)` over calibrated standard deviations: about 1."""
    ratio: FloatArray = np.sqrt(((errors * Z95 / half_widths) ** 2).mean(axis=1))
    return ratio


def scores_by_trajectory(ratio: FloatArray, trajectory: IntArray) -> FloatArray:
    """Root mean squares of ratios `(n,)`, a trajectory each, in the order in which they come."""
    ids, first = np.unique(trajectory, return_index=True)
    ordered = ids[np.argsort(first)]
    return np.array([np.sqrt((ratio[trajectory == number] ** 2).mean()) for number in ordered])
