"""Sizes that checks compare: extents, spreads, steps, runs, rigid misfit."""

from __future__ import annotations

import numpy as np
from scipy.stats import spearmanr

from gpcorrect import se3
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

__all__ = ["extent", "repeats", "rigid_misfit", "runs", "spread", "spread_ratio", "step_lengths"]

MIN_CORRELATION = 0.8  # of ranks: two signals of one joint agree at least so well, whatever their units
MIN_PAIRED = 20


def extent(positions: FloatArray) -> float:
    """Diagonal of the box that holds positions `(n, 3)` between the 1st and 99th percentile; 0 without samples."""
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
    """How many times wider `(n,)` values vary than a reference that they follow; NaN where they do not follow."""
    known = np.isfinite(values) & np.isfinite(reference)
    a, b = values[known], reference[known]
    if len(a) < MIN_PAIRED or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    if abs(float(spearmanr(a, b).statistic)) < MIN_CORRELATION:
        return float("nan")
    wide_a, wide_b = (float(np.diff(np.percentile(x, [5, 95]))[0]) for x in (a, b))
    return wide_a / wide_b if wide_b > 0 else float("nan")


def step_lengths(log: CalibrationLog, positions: FloatArray) -> FloatArray:
    """Distance `(n,)` from the row before in the same trajectory; NaN for its first row and at missing samples."""
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
    """Median distance left, m, after the best rigid motion of points `(n, 3)` onto their targets; NaN for too few."""
    known = np.isfinite(points).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return float("nan")
    a = points[known] - np.median(points[known], axis=0)
    b = target[known] - np.median(target[known], axis=0)
    left = b - a @ se3.nearest_rotation(b.T @ a).T
    return float(np.median(np.linalg.norm(left - np.median(left, axis=0), axis=1)))
