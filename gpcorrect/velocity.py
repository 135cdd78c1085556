"""Velocities of recorded paths and of live streams, on the times as they are: uneven, with gaps.

A path is differentiated by finite-difference weights through five samples (Fornberg 1988), exact for
polynomials up to degree four on any spacing. Where a stencil step is asked for that more samples fall into, a
least-squares parabola through all of them (Savitzky and Golay 1964) takes its place: exact for quadratics, and its
noise falls with the number of samples. A stream is differentiated by such a parabola through the recent past.
Angular velocity is that of the local rotation vector log(R_j R_i^T) at sample i, so it is expressed in the
spatial frame and is exact for a constant spin.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, IntArray

STENCIL = 5  # points: exact to degree four (Fornberg 1988)
MOST = 49  # samples that a parabola is fitted to, spread evenly over its window: memory stays bounded at any rate
BLOCK = 4096  # rows differentiated at once
GAP_STEPS = 5.0  # a step this many times the median one is a gap
FIT_SAMPLES = 3  # a parabola needs three, however slow the stream


def sampled_rows(known: BoolArray) -> IntArray:
    """Rows of a log at which a sensor was read: of one slower than the log, those with a value; all rows otherwise.

    Where every other row or more is empty as a rule, an empty row is no sample that was lost.

    Parameters
    ----------
    known : (n,) mask, rows in which the sensor has a value
    """
    rows = np.flatnonzero(known)
    slower = len(rows) > 1 and np.median(np.diff(rows)) > 1
    return rows if slower else np.arange(len(known))


def segment_labels(time: ArrayLike, trajectory: ArrayLike, keep: ArrayLike | None = None) -> IntArray:
    """Label the unbroken runs of used samples inside one trajectory: 0, 1... in row order, -1 where not used.

    A step longer than five times the trajectory's median one breaks the run.

    Parameters
    ----------
    time : (n,) array, seconds
    trajectory : (n,) int array, which motion a sample belongs to
    keep : (n,) bool array, optional
        False for a rejected or missing sample, which breaks the run; all are used by default.

    Raises
    ------
    DataError
        The arrays differ in length, or a time is not finite.
    """
    t, motion = np.asarray(time, dtype=np.float64), np.asarray(trajectory)
    used: BoolArray = np.ones(t.shape, dtype=bool) if keep is None else np.asarray(keep, dtype=bool)
    if t.ndim != 1 or motion.shape != t.shape or used.shape != t.shape:
        raise DataError(f"time, trajectory and keep must be (n,) each, got {t.shape}, {motion.shape}, {used.shape}.")
    if not np.isfinite(t).all():
        raise DataError(f"time of sample {int(np.argmin(np.isfinite(t)))} is not finite.")
    longest, inside = np.full(t.shape, np.inf), np.flatnonzero(motion[1:] == motion[:-1]) + 1
    for number in np.unique(motion[inside]):
        rows = inside[motion[inside] == number]
        longest[motion == number] = GAP_STEPS * np.median(t[rows] - t[rows - 1])
    follows = used[1:] & used[:-1] & (motion[1:] == motion[:-1]) & (np.diff(t) <= longest[1:])
    starts = used & ~np.concatenate([np.zeros(min(1, t.size), dtype=bool), follows])
    return np.where(used, np.cumsum(starts) - 1, -1)


def derivative(time: ArrayLike, values: ArrayLike, labels: ArrayLike, step: float | None = None) -> FloatArray:
    """Time derivative on the actual times, never across labels: five-point differences, or parabolas over a step.

    Windows are one-sided at the ends of a run and hold fewer points in runs shorter than five. Five points are
    exact for polynomials up to degree four, parabolas for quadratics.

    Parameters
    ----------
    time : (n,) array
        Seconds, strictly increasing inside a label.
    values : (n, k) array, what to differentiate
    labels : (n,) int array
        Runs, as from :func:`segment_labels`; -1 belongs to none.
    step : float, optional
        Stencil step h, s, so that noise is divided by h: a least-squares parabola through all samples from t-2h to
        t+2h, or where these are no more than five, the five nearest to t-2h, t-h, t, t+h, t+2h. Adjacent samples by
        default.

    Raises
    ------
    DataError
        Shapes differ, `step` is not positive, or time repeats or runs backward inside a run.
    """
    t, x, runs = _checked(time, values, labels, step)
    result = np.full(x.shape, np.nan)
    for rows, window in _windows(t, runs, step):
        weights = _slope_weights(t[window], t[rows])
        # Differences to the sample itself: weights sum to zero, so a large offset loses no digits.
        result[rows] = np.einsum("nm,nmk->nk", weights, x[window] - x[rows, None])
    return result


def twists(
    time: ArrayLike, positions: ArrayLike, rotations: ArrayLike | None, labels: ArrayLike, step: float | None = None
) -> FloatArray:
    """Linear (m/s) and spatial-frame angular velocity (rad/s) of a path, `(n, 6)`; NaN where there is no derivative.

    Parameters
    ----------
    time : (n,) array, seconds
    positions : (n, 3) array, metres
    rotations : (n, 3, 3) array or None
        Rotation matrices; None leaves the angular part NaN. The body must turn by less than pi between the
        middle and the ends of a window.
    labels, step : see :func:`derivative`
    """
    t, p, runs = _checked(time, positions, labels, step)
    angular = np.full((len(t), 3), np.nan)
    if rotations is not None:
        R = np.asarray(rotations, dtype=np.float64)
        if R.shape != (len(t), 3, 3):
            raise DataError(f"rotations must have shape ({len(t)}, 3, 3), got {R.shape}.")
        for rows, window in _windows(t, runs, step):
            local = se3.rotvec_from_matrix(R[window] @ np.swapaxes(R[rows], -1, -2)[:, None])
            angular[rows] = np.einsum("nm,nmk->nk", _slope_weights(t[window], t[rows]), local)
    return np.concatenate([derivative(t, p, runs, step), angular], axis=1)


class CausalTwist:
    """Twist of a live stream from past samples only: the end slope of a parabola fitted to a short window.

    Exact for straight motion at constant velocity and for constant spin. Two samples give a line's slope, one
    gives NaN.

    Parameters
    ----------
    window : float
        Length of the past that is fitted, s; at least three samples are used however slow the stream.
    max_gap : float, a longer pause, s, forgets the past
    """

    def __init__(self, window: float = 0.1, max_gap: float = 0.5) -> None:
        if not (window > 0 and max_gap > 0):
            raise DataError(f"window and max_gap must be positive seconds, got {window} and {max_gap}.")
        self.window = window
        self.max_gap = max_gap
        self._past: deque[tuple[float, FloatArray, FloatArray | None]] = deque()

    def reset(self) -> None:
        """Forget the past, as after a gap."""
        self._past.clear()

    def update(self, time: float, position: ArrayLike, rotation: ArrayLike | None = None) -> FloatArray:
        """Take one sample and return the twist `(6,)` at it: m/s, then rad/s in the spatial frame.

        Parameters
        ----------
        time : float, seconds, later than the sample before
        position : (3,) array, metres
        rotation : (3, 3) array, optional
            Rotation matrix; without it the angular part is NaN.

        Raises
        ------
        DataError
            Time does not advance, or the sample is not finite or of another shape; the past stays.
        """
        p = np.array(position, dtype=np.float64)
        R = None if rotation is None else np.array(rotation, dtype=np.float64)
        self._check(time, p, R)
        if self._past and time - self._past[-1][0] > self.max_gap:
            self.reset()
        self._past.append((time, p, R))
        while len(self._past) > FIT_SAMPLES and time - self._past[0][0] > self.window:
            self._past.popleft()
        past_times = np.array([sample[0] for sample in self._past])
        linear = _end_slope(past_times, np.array([sample[1] for sample in self._past]))
        if R is None:
            return np.concatenate([linear, np.full(3, np.nan)])
        turned = [(t, past) for t, _, past in self._past if past is not None]
        local = se3.rotvec_from_matrix(np.array([past for _, past in turned]) @ R.T)
        return np.concatenate([linear, _end_slope(np.array([t for t, _ in turned]), local)])

    def _check(self, time: float, position: FloatArray, rotation: FloatArray | None) -> None:
        if position.shape != (3,) or (rotation is not None and rotation.shape != (3, 3)):
            came = None if rotation is None else rotation.shape
            raise DataError(f"a sample is a position (3,) and a rotation (3, 3) or None, got {position.shape}, {came}.")
        if not (np.isfinite([time, *position]).all() and (rotation is None or np.isfinite(rotation).all())):
            raise DataError(f"the sample at time {time} is not finite.", hint="Leave a missing sample out.")
        if self._past and time <= self._past[-1][0]:
            raise DataError(f"time must advance: {time} s came after {self._past[-1][0]} s.")


def _checked(
    time: ArrayLike, values: ArrayLike, labels: ArrayLike, step: float | None
) -> tuple[FloatArray, FloatArray, IntArray]:
    t, x = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    runs = np.asarray(labels, dtype=np.int64)
    if t.ndim != 1 or x.ndim != 2 or len(x) != len(t) or runs.shape != t.shape:
        raise DataError(f"time (n,), values (n, k) and labels (n,) must match, got {t.shape}, {x.shape}, {runs.shape}.")
    if step is not None and not step > 0:
        raise DataError(f"the stencil step must be positive seconds, got {step}.")
    stuck = np.flatnonzero((runs[1:] == runs[:-1]) & (runs[1:] >= 0) & ~(np.diff(t) > 0))
    if stuck.size:
        i = int(stuck[0])
        hint = "Drop repeated and backward samples, or give them label -1."
        raise DataError(f"time does not advance from sample {i} ({t[i]} s) to {i + 1} ({t[i + 1]} s).", hint=hint)
    return t, x, runs


def _windows(time: FloatArray, labels: IntArray, step: float | None) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield (rows (r,), their windows (r, m)) for each window size m that occurs, from 2 up, some rows at a time."""
    begins = np.flatnonzero(np.concatenate([[True], labels[1:] != labels[:-1]])[: labels.size])
    run = np.searchsorted(begins, np.arange(labels.size), side="right") - 1
    first, stop = begins[run], np.append(begins[1:], labels.size)[run]  # of the run that every sample lies in
    inside = np.where(labels >= 0, stop - first, 0)
    low, high = (first, stop) if step is None else _spans(time, first, stop, step)
    dense = (inside > STENCIL) & (high - low > STENCIL) if step is not None else np.zeros(len(time), dtype=bool)
    size = np.where(dense, np.minimum(high - low, MOST), np.minimum(inside, STENCIL))
    for m in np.unique(size[size > 1]):
        all_rows = np.flatnonzero(size == m)
        for rows in (all_rows[start : start + BLOCK] for start in range(0, len(all_rows), BLOCK)):
            if m > STENCIL:
                yield rows, low[rows, None] + np.arange(m) * (high - low - 1)[rows, None] // (m - 1)
            elif m == STENCIL and step is not None:
                yield rows, _spread_window(time, rows, first[rows], stop[rows], step)
            else:
                yield rows, np.clip(rows - m // 2, first[rows], stop[rows] - m)[:, None] + np.arange(m)


def _spans(time: FloatArray, first: IntArray, stop: IntArray, step: float) -> tuple[IntArray, IntArray]:
    """First row and one past the last, `(n,)` each, of the window t-2h to t+2h, shifted and shrunk to fit the run."""
    half = 0.5 * (STENCIL - 1) * step
    begin, end = time[first], time[stop - 1]
    middle = np.clip(time, np.minimum(begin + half, end), np.maximum(end - half, begin))
    low = _nearest_row(time, middle - half, first, stop - 1)
    high = _nearest_row(time, middle + half, first, stop - 1)
    return low, high + 1


def _spread_window(time: FloatArray, rows: IntArray, first: IntArray, stop: IntArray, step: float) -> IntArray:
    """Windows `(r, 5)` of distinct samples nearest to t-2h ... t+2h, shifted and shrunk to fit the run."""
    begin, end = time[first], time[stop - 1]
    h = np.minimum(step, (end - begin) / (STENCIL - 1))
    middle = np.clip(time[rows], begin + 2 * h, end - 2 * h)
    targets = middle[:, None] + h[:, None] * np.arange(-2, 3)
    window = np.empty(targets.shape, dtype=np.int64)
    for j in range(STENCIL):
        window[:, j] = _nearest_row(time, targets[:, j], first + j, stop - STENCIL + j)
        if j:  # coarse sampling may name a sample twice; the window needs five
            window[:, j] = np.maximum(window[:, j], window[:, j - 1] + 1)
    return window


def _nearest_row(time: FloatArray, target: FloatArray, low: IntArray, high: IntArray) -> IntArray:
    """Row from `low` to `high` (both included, one run) whose time is nearest to `target`, by bisection."""
    left, right = low.copy(), high.copy()
    while (right - left > 1).any():
        middle = (left + right) // 2
        later = time[middle] > target
        left, right = np.where(later, left, middle), np.where(later, middle, right)
    return np.where(np.abs(time[left] - target) <= np.abs(time[right] - target), left, right)


def _slope_weights(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Weights `(r, m)` of the first derivative at `at` (r,): through up to five nodes, between more of them."""
    return _lagrange_weights(nodes, at) if nodes.shape[1] <= STENCIL else _parabola_weights(nodes, at)


def _parabola_weights(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Weights `(r, m)` of the slope at `at` (r,) of the least-squares parabola through the samples at `nodes` (r, m).

    The parabola is written in polynomials that are orthogonal on the nodes, so nothing needs to be inverted.
    """
    span = nodes[:, -1:] - nodes[:, :1]
    middle = nodes.mean(axis=1, keepdims=True)
    x, x_at = (nodes - middle) / span, (at[:, None] - middle) / span
    squares = (x * x).mean(axis=1, keepdims=True)
    skew = (x**3).mean(axis=1, keepdims=True) / squares
    second = x * x - skew * x - squares
    slope = x / (x * x).sum(axis=1, keepdims=True)
    bend = second / (second * second).sum(axis=1, keepdims=True)
    weights: FloatArray = (slope + (2.0 * x_at - skew) * bend) / span
    return weights


def _lagrange_weights(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Weights `(r, m)` of the first derivative at `at` (r,) through the samples at `nodes` (r, m).

    They are the derivatives of the Lagrange polynomials, which Fornberg's recursion (1988) also yields.
    """
    x = nodes - at[:, None]
    weights = np.empty_like(x)
    for j in range(x.shape[1]):
        value, slope = np.ones(len(x)), np.zeros(len(x))
        for k in (k for k in range(x.shape[1]) if k != j):
            span = x[:, j] - x[:, k]
            value, slope = value * -x[:, k] / span, (value - slope * x[:, k]) / span
        weights[:, j] = slope
    return weights


def _end_slope(time: FloatArray, values: FloatArray) -> FloatArray:
    """Slope `(k,)` at the last of `values` (n, k) of their least-squares parabola; NaN for one sample."""
    if len(time) < 2:
        return np.full(values.shape[1], np.nan)
    span = time[-1] - time[0]
    design = np.vander((time - time[-1]) / span, min(3, len(time)), increasing=True)
    coefficients = np.linalg.lstsq(design, values - values[-1], rcond=None)[0]
    slope: FloatArray = coefficients[1] / span
    return slope
