"""Operators with memory that several effects share; time runs along the first axis."""

from __future__ import annotations

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["play"]


def play(path: FloatArray, radius: float) -> FloatArray:
    """Play (backlash) of half width `radius`: the output moves only when the input pushes an edge of the gap.

    `w_i = min(max(w_{i-1}, u_i - r), u_i + r)`, exact for any input that is monotone between samples; it starts in the
    middle of the gap (Krasnosel'skii and Pokrovskii 1989, Sec. 2).

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    radius : float
        Half width of the gap, in the unit of the path.

    Returns
    -------
    (n, ...) array
        Output.

    Raises
    ------
    DataError
        The radius is negative.
    """
    if not radius >= 0:
        raise DataError(f"the half width of a play must be >= 0, got {radius}.")
    low, high = path - radius, path + radius
    output = np.array(path)
    state = np.array(path[0])
    for i in range(1, len(path)):
        np.maximum(state, low[i], out=state)
        np.minimum(state, high[i], out=state)
        output[i] = state
    return output
