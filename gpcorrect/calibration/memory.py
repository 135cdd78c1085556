"""Memory features: where in its slack the arm is, from what it was commanded so far.

Cables rub and stretch, so a joint that comes from the left stands elsewhere than one that comes from the right. The
states of play operators of several radii (the Prandtl-Ishlinskii model of hysteresis, Kuhnen 2003) say from where the
path came. They act on the tool's position and its turns about its own axes; where a log holds joints, the slack is
sought there instead (:mod:`gpcorrect.calibration.joint_route`).

Slack follows the drive, and the drive follows the commands, which are known without noise: so the states are those that
the commands up to the sample before left behind. Only the last step is the desired path's, for its command is what is
asked for. (States of the path that a tracker saw drown in its noise where that is as large as the slack.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gpcorrect import se3
from gpcorrect.calibration.law import Law
from gpcorrect.play import play_states
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal, frozen_array

LADDER = (1.0, 3.0)  # radii over the smallest of them; chosen by hand
SMALLEST = (0.0125, 0.025, 0.05, 0.1, 0.2)
"""Smallest radius over half the range of training, to choose from; chosen by hand."""
RANGE_QUANTILES = (2.5, 97.5)  # per cent: a few outliers do not widen a range; chosen by hand
LONGER_PATHS = 90  # per cent: short paths do not show how far a coordinate goes; chosen by hand
LEAST_RANGE = 1e-6  # m or rad: a coordinate that never moves has a slack all the same; chosen by hand
RIDGE = 1e-3  # of the samples, so that features that do not vary leave the system solvable; chosen by hand


@dataclass(frozen=True, eq=False)
class MemoryMap:
    """From a path to its memory features, all within [-1, 1]."""

    # (h, k) half widths of the slacks in the tool's position, m, and its turns about its own axes, rad
    radii: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii", frozen_array(self.radii))

    def transform(self, command: PoseSignal, reference: PoseSignal, labels: IntArray) -> FloatArray:
        """Return features `(n, h k)` of paths; every label is a path of its own, which starts amid the slack.

        Parameters
        ----------
        command, reference : PoseSignal
            n poses that were commanded, and the references asked for; orientations count where k is 6.
        labels : (n,) int array, path of each sample
        """
        commanded, asked = (steps(poses)[:, : self.radii.shape[1]] for poses in (command, reference))
        left = play_states(commanded, self.radii, labels)
        states = np.zeros(left.shape)
        states[1:] = advance(left[:-1], asked[1:, None], self.radii)
        states[1:][labels[1:] != labels[:-1]] = 0.0
        return self.features(states)

    def features(self, states: FloatArray) -> FloatArray:
        """Return features `(..., h k)` of states `(..., h, k)`.

        Parameters
        ----------
        states : (..., h, k) array, lags inside the slacks, m or rad
        """
        return (states / self.radii).reshape(*states.shape[:-2], -1)


@dataclass(frozen=True, eq=False)
class Memory:
    """What was learned a second time, with memory features, for paths and streams."""

    states: MemoryMap  # from a path of reference poses to its memory features
    law: Law  # its inputs end in those features


def advance(state: FloatArray, step: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the states `(h, k)` after one step `(k,)` of the path, for radii `(h, k)`.

    The state of a play (Krasnosel'skii and Pokrovskii 1989, Sec. 2) is how far its output lags behind its input, `d = u
    - w` in [-r, r]: the input moves freely inside the slack and drags the output at its edges, `d' = clip(d + du, -r,
    r)`. Exact for an input that is monotone during the step; where the path was before never matters.

    Parameters
    ----------
    state : (..., h, k) array, lags before the step
    step : (..., 1, k) or (k,) array, step of each coordinate, m or rad
    radii : (h, k) array, half widths of the slacks, m or rad
    """
    return np.clip(state + step, -radii, radii)


def choose_memory(
    command: PoseSignal, reference: PoseSignal, labels: IntArray, X: FloatArray, Y: FloatArray, folds: IntArray
) -> tuple[MemoryMap, float]:
    """Choose radii by what they explain, at trajectories left out, beside the other inputs; and return how much.

    That is the fraction of its squared errors that a linear law of these inputs loses by memory, the mean of the
    coordinates. Beside them, for a velocity says in part what memory does: what it took is not in the errors it leaves.

    Parameters
    ----------
    command, reference, labels
        Training paths, see :meth:`MemoryMap.transform`.
    X, Y : (n, d) and (n, m) arrays, inputs without memory, and targets, m of 6 with orientations
    folds : (n,) array, which samples are left out together
    """
    half = _half_range(steps(command)[:, : Y.shape[1]], labels)
    maps = [MemoryMap(smallest * np.outer(LADDER, half)) for smallest in SMALLEST]
    known, target = ((part - part.mean(axis=0)) / np.maximum(part.std(axis=0), 1e-300) for part in (X, Y))
    before = np.maximum(left_out_squares(known, target, folds), 1e-300)
    features = [states.transform(command, reference, labels) for states in maps]
    left = [float((left_out_squares(np.hstack([known, F]), target, folds) / before).mean()) for F in features]
    return maps[int(np.argmin(left))], 1.0 - min(left)


def _half_range(moved: FloatArray, labels: IntArray) -> FloatArray:
    """Half the range `(k,)` that the coordinates cover inside one of the longer paths."""
    spans = []
    for label in np.unique(labels):
        path = np.cumsum(moved[labels == label][1:], axis=0)  # the first step leads here from another path
        if len(path):
            low, high = np.percentile(path, RANGE_QUANTILES, axis=0)
            spans.append(high - low)
    half: FloatArray = np.percentile(spans, LONGER_PATHS, axis=0) / 2
    return np.maximum(half, LEAST_RANGE)


def steps(poses: PoseSignal) -> FloatArray:
    """Return steps `(n, k)` of the tool's position and its turns about its own axes; the first is zero.

    Parameters
    ----------
    poses : PoseSignal, n poses, in order; without orientation there are no turns
    """
    linear = np.diff(poses.position, axis=0, prepend=poses.position[:1])
    if poses.quaternion is None:
        return linear
    rotations = se3.matrix_from_quaternion(poses.quaternion)
    before = np.concatenate([rotations[:1], rotations[:-1]])
    return np.hstack([linear, se3.rotvec_from_matrix(np.swapaxes(before, -1, -2) @ rotations)])


def left_out_squares(F: FloatArray, Y: FloatArray, folds: IntArray, penalties: FloatArray | None = None) -> FloatArray:
    """Return the mean square `(m,)` of targets in left-out folds after a linear function of features.

    Parameters
    ----------
    F, Y : (n, d) and (n, m) arrays, features and targets
    folds : (n,) int array, what is left out together
    penalties : (d,) array, optional, on squared weights, in units of the samples; the offset is free then
    """
    A, total = np.hstack([F, np.ones((len(F), 1))]), np.zeros(Y.shape[1])
    ridge = np.full(A.shape[1], RIDGE) if penalties is None else np.append(penalties, 0.0)
    for fold in np.unique(folds):
        out: BoolArray = folds == fold
        inside = A[~out]
        normal = inside.T @ inside + len(inside) * np.diag(ridge)
        total += ((Y[out] - A[out] @ np.linalg.solve(normal, inside.T @ Y[~out])) ** 2).sum(axis=0)
    return total / len(Y)


def spans(path: FloatArray, new: BoolArray) -> FloatArray:
    """Return how far apart the ends of what a path `(n, d)` has covered so far are `(n, d)`; 0 where `new`.

    Parameters
    ----------
    path : (n, d) array, positions
    new : (n,) mask, where a path starts
    """
    parts = np.split(path, np.flatnonzero(new)[1:])
    return np.vstack([np.maximum.accumulate(part) - np.minimum.accumulate(part) for part in parts])


@njit(cache=True)
def lag_step(behind: FloatArray, moved: FloatArray, step: float, constants: FloatArray) -> FloatArray:
    """Return by how much lags `(t, d)` are behind a signal that moved evenly by `moved` (d,) during `step`.

    d behind / dt = d signal / dt - behind / tau, solved exactly: samples between two others change nothing.

    Parameters
    ----------
    behind : (t, d) array, by how much they were
    moved : (d,) array, what the signal moved by; where that is not known it is taken to have stood
    step : float, s; 0 where two samples have one stamp
    constants : (t,) array, time constants tau, s
    """
    after = np.empty((len(constants), len(moved)))
    for t in range(len(constants)):
        left = np.exp(-step / constants[t])
        fraction = (1.0 - left) * constants[t] / step if step > 0.0 else 1.0
        for j in range(len(moved)):
            after[t, j] = behind[t, j] * left + (moved[j] * fraction if np.isfinite(moved[j]) else 0.0)
    return after


@njit(cache=True)
def lagged(signal: FloatArray, time: FloatArray, new: BoolArray, constants: FloatArray) -> FloatArray:
    """Return by how much first-order lags `(n, t, d)` are behind a signal; where `new`, by nothing.

    Parameters
    ----------
    signal : (n, d) array, positions or efforts; where one is not known, it is taken to have stood
    time : (n,) array, s
    new : (n,) mask, where a path starts
    constants : (t,) array, time constants tau, s
    """
    n, d = signal.shape
    behind = np.zeros((n, len(constants), d))
    last, moved = np.empty(d), np.empty(d)
    for j in range(d):
        last[j] = np.nan
    for i in range(n):
        for j in range(d):
            moved[j] = signal[i, j] - last[j]
            if new[i] or np.isfinite(signal[i, j]):
                last[j] = signal[i, j]
        if not new[i]:
            after = lag_step(behind[i - 1], moved, time[i] - time[i - 1], constants)
            for t in range(len(constants)):
                for j in range(d):
                    behind[i, t, j] = after[t, j]
    return behind
