"""What a training motion can show: where effects look alike in it, none of them may be learned.

A joint that never turns back holds its slack on one side, like an offset; a joint that knows one speed shows friction
and damping as one. A calibration that learned such a feature would be wrong on every other motion, and its held-out
trajectories of the same kind would not tell.
"""

from __future__ import annotations

import numpy as np

from gpcorrect.play import play_states
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["has_many_speeds", "turns_back"]

SLACK = 0.05  # half ranges
FEWEST_TURNS = 8  # of the slack from one side to the other, to tell it from position and effort
MOVING = 0.05  # of a joint's highest speed
LEAST_SPEEDS = 1.5  # ratio of faster to slower motion, to tell what grows with speed from what does not


def turns_back(path: FloatArray, new: BoolArray) -> BoolArray:
    """Which joints `(d,)` of a path `(n, d)`, in half ranges, turn back often enough to show their slack."""
    steps = np.diff(path, axis=0, prepend=path[:1])
    states = play_states(steps, np.full((1, path.shape[1]), SLACK), np.cumsum(new))[:, 0]
    sides = [column[np.abs(column) > 0.99 * SLACK] > 0 for column in states.T]
    return np.array([np.count_nonzero(side[1:] != side[:-1]) >= FEWEST_TURNS for side in sides])


def has_many_speeds(velocity: FloatArray) -> BoolArray:
    """Which joints `(d,)` move at speeds far enough apart: the upper quartile of theirs is well above the lower."""
    return np.array([_ratio(speed[speed > MOVING * speed.max()]) >= LEAST_SPEEDS for speed in np.abs(velocity).T])


def _ratio(speed: FloatArray) -> float:
    if speed.size == 0:
        return 1.0
    low, high = np.percentile(speed, (25, 75))
    return float(high / low)
