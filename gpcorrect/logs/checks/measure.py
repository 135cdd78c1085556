"""Sizes that checks compare: extents, spreads, steps, runs, rigid misfit."""

from __future__ import annotations

import numpy as np
from scipy.stats import spearmanr

from gpcorrect import se3
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

__all__ = ["extent", "mirrored", "repeats", "rigid_misfit", "runs", "spread", "spread_ratio", "step_lengths"]

MIN_CORRELATION = 0.8  # of ranks: two signals of one joint agree at least so well, whatever their units
MIN_PAIRED = 20
MIN_EXPLAINED = 0.9  # of the spread; below it the handedness is not clear
MIN_THICKNESS = 0.05  # of the widest direction: flat motions have no handedness


def extent(positions: FloatArray) -> float:
    """Diagonal of the box around positions `(n, 3)`, 1st to 99th percentile; 0 without samples."""
    known = positions[np.isfinite(positions).all(axis=1)]
    if not len(known):
        return 0.0
    low, high = np.percentile(known, [1, 99], axis=0)
    return float(np.linalg.norm(high - low))


def spread(values: FloatArray) -> float:
    """Median distance of rows `(n, k)` from their median; 0 without samples."""
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known):
        return 0.0
    return float(np.median(np.linalg.norm(known - np.median(known, axis=0), axis=1)))


def spread_ratio(values: FloatArray, reference: FloatArray) -> float:
    """How many times wider `(n,)` values vary than a reference that they follow; NaN if they do not."""
    known = np.isfinite(values) & np.isfinite(reference)
    a, b = values[known], reference[known]
    if len(a) < MIN_PAIRED or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    if abs(float(spearmanr(a, b).statistic)) < MIN_CORRELATION:
        return float("nan")
    wide_a, wide_b = (float(np.diff(np.percentile(x, [5, 95]))[0]) for x in (a, b))
    return wide_a / wide_b if wide_b > 0 else float("nan")


def step_lengths(log: CalibrationLog, positions: FloatArray) -> FloatArray:
    """Distance `(n,)` from the row before in the same trajectory; NaN where either is missing."""
    move = np.full(len(log), np.nan)
    for _, rows in log.trajectories():
        move[rows[1:]] = np.linalg.norm(np.diff(positions[rows], axis=0), axis=1)
    return move


def repeats(log: CalibrationLog, table: FloatArray) -> BoolArray:
    """(n,) mask of rows that equal the row before in the same trajectory to the last bit."""
    same = np.zeros(len(log), dtype=np.bool_)
    for _, rows in log.trajectories():
        same[rows[1:]] = (table[rows[1:]] == table[rows[:-1]]).all(axis=1)
    return same


def runs(mask: BoolArray) -> IntArray:
    """Unbroken runs of True as `(r, 2)`: first row, and the row after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)


def rigid_misfit(points: FloatArray, target: FloatArray) -> float:
    """Median distance, m, left by the best rigid motion of points `(n, 3)` onto targets; NaN for too few."""
    known = np.isfinite(points).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return float("nan")
    a = points[known] - np.median(points[known], axis=0)
    b = target[known] - np.median(target[known], axis=0)
    left = b - a @ se3.nearest_rotation(b.T @ a).T
    return float(np.median(np.linalg.norm(left - np.median(left, axis=0), axis=1)))


def mirrored(reference: FloatArray, observed: FloatArray) -> bool:
    """Whether the best affine map of points `(n, 3)` onto others reverses space; no where it is unclear."""
    known = np.isfinite(reference).all(axis=1) & np.isfinite(observed).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return False
    x, y = reference[known], observed[known]
    x, y = x - np.median(x, axis=0), y - np.median(y, axis=0)
    extents = np.linalg.svd(x, compute_uv=False)
    if extents[2] < MIN_THICKNESS * extents[0]:
        return False
    matrix = np.linalg.lstsq(x, y, rcond=None)[0]
    left, total = np.median(np.sum((y - x @ matrix) ** 2, axis=1)), np.median(np.sum(y**2, axis=1))
    return bool(left < (1 - MIN_EXPLAINED) * total and np.linalg.det(matrix) < 0)
