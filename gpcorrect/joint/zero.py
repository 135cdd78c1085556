"""The zero of each joint: how it wandered in training, and where it stood last.

A local level model (Durbin and Koopman 2012, Sec. 2.1) of each trajectory's mean error, in its steady form: exponential
smoothing, whose gain is chosen by how well it foretells the next trajectory. A zero that holds still gets gain 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray, IntArray

__all__ = ["ZeroPath", "zero_path"]

GAINS = (0.0, 0.1, 0.2, 0.4, 0.7)
FEWEST = 8  # trajectories from which a wandering zero can be told from chance
CLEARLY = 0.95  # of the squared error without wandering, for a gain above 0


@dataclass(frozen=True, eq=False)
class ZeroPath:
    """Zero at each training sample, and the last one.

    Parameters
    ----------
    samples : (n, d) array
        Smoothed from both sides.
    last : (d,) array
        Where the zeros stand when training ends, relative to their mean.
    """

    samples: FloatArray
    last: FloatArray


def zero_path(errors: FloatArray, trajectory: IntArray) -> ZeroPath:
    """Return the wandering part of errors `(n, d)` of trajectories in recorded order."""
    _, first, number = np.unique(trajectory, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    number = place[number]
    means = np.array([errors[number == k].mean(axis=0) for k in range(len(order))])
    if len(means) < FEWEST:
        return ZeroPath(np.zeros(errors.shape), np.zeros(errors.shape[1]))
    paths = [_wander(means[:, joint]) for joint in range(errors.shape[1])]
    smooth = np.column_stack([(ahead + back) / 2 for ahead, back in paths])
    return ZeroPath(smooth[number], np.array([ahead[-1] for ahead, _ in paths]))


def _wander(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Levels after each trajectory, filtered ahead and backwards; zeros where the level holds still."""
    centred = means - means.mean()
    warm = max(2, len(means) // 10)
    squares = [float(np.mean((centred[warm:] - _before(centred, gain)[warm:]) ** 2)) for gain in GAINS]
    best = int(np.argmin(squares))
    if squares[best] > CLEARLY * squares[0]:
        return np.zeros(len(means)), np.zeros(len(means))
    gain = GAINS[best]
    return _levels(centred, gain), _levels(centred[::-1], gain)[::-1]


def _levels(values: FloatArray, gain: float) -> FloatArray:
    level, levels = 0.0, np.empty(len(values))
    for k, value in enumerate(values):
        level += gain * (value - level)
        levels[k] = level
    return levels


def _before(values: FloatArray, gain: float) -> FloatArray:
    return np.concatenate([[0.0], _levels(values, gain)[:-1]])
