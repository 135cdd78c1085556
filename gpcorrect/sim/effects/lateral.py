"""What presses across the instrument's shaft."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

__all__ = ["lateral_force"]


def lateral_force(tip: FloatArray, tip_force: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Part of the force at the tip that acts across the shaft, and the shaft's free length.

    The shaft runs from the remote centre of motion, which is the base origin of every arm here, to the tip.

    Parameters
    ----------
    tip : (n, N, 3) array
        Tip positions, base frame, m.
    tip_force : (N, 3) array or None
        Force on the tip in each run, base frame, N; None is none.

    Returns
    -------
    force : (n, N, 3) array
        N, base frame.
    length : (n, N, 1) array
        m.
    """
    length = np.linalg.norm(tip, axis=-1, keepdims=True)
    if tip_force is None:
        return np.zeros(tip.shape), length
    along = tip / np.maximum(length, 1e-12)
    force: FloatArray = tip_force - (along * tip_force).sum(axis=-1, keepdims=True) * along
    return force, length
