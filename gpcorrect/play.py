"""Where in its slack a path stands: states of play operators, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray, IntArray


def play_states(steps: FloatArray, radii: FloatArray, labels: IntArray) -> FloatArray:
    """Return the states `(n, h, k)` along paths with steps `(n, k)` from the row before, for radii `(h, k)`.

    Every label `(n,)` is a path of its own: it starts in the middle of the slack, where nothing is known, and its first
    step is not looked at.

    Parameters
    ----------
    steps : (n, k) array, steps from the row before, m or rad
    radii : (h, k) array, half widths of the slacks, m or rad
    labels : (n,) int array, path of each row
    """
    return _followed(np.ascontiguousarray(steps), np.ascontiguousarray(radii), np.asarray(labels))


@njit(cache=True)
def _followed(steps: FloatArray, radii: FloatArray, labels: IntArray) -> FloatArray:
    n, d = steps.shape
    states = np.zeros((n, len(radii), d))
    for i in range(1, n):
        if labels[i] == labels[i - 1]:
            for h in range(len(radii)):
                for j in range(d):
                    states[i, h, j] = min(max(states[i - 1, h, j] + steps[i, j], -radii[h, j]), radii[h, j])
    return states
