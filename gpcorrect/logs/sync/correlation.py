"""Coarse search: how well do two speeds agree at each lag, over all trajectories together.

The norm of a velocity is the same in every frame, so two speeds can be compared before the frames are registered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from gpcorrect.logs.streams import default_max_gap
from gpcorrect.logs.sync.motion import Motion, MotionPair
from gpcorrect.types import BoolArray, FloatArray, IntArray

MIN_STEP = 0.005  # s; finer grids cost time and add nothing: a parabola and the refinement find the rest
MIN_WIDTH = 0.03  # s; the standard deviation of the low pass, 5 Hz: arms under control move slower than that
MAX_CELLS = 2_000_000  # of a grid; beyond that it is coarsened
SPIKE_WINDOW = 7  # samples; their median stands up to three outliers in a row
SPIKE_SCALE = 6.0  # times farther from that median than its neighbours, and than four in five samples: a spike
CLIP = 2.0  # speeds count up to this many times the fast ones: a jump of the tracker is a huge speed
MIN_SUPPORT = 0.5  # a smoothed speed needs this fraction of its window
PEAK_SHARE = 0.5  # lesser peaks than this fraction of the highest are no rivals
MIN_COMMON = 0.25  # a lag needs this fraction of the most samples in common at any lag


@dataclass(frozen=True, eq=False)
class LagCurve:
    """Correlation of two speeds over lags."""

    lags: FloatArray  # (m,) seconds that the observer's stamps run ahead of the reference's
    correlation: FloatArray  # (m,) pooled correlation coefficient, NaN where too few samples are in common
    variation: float  # standard deviation of the reference's speed in units of its mean; 0 where nothing moves


def slower_step(pairs: Sequence[MotionPair]) -> float:
    """Median time step, s, of the slower of two signals; infinite when there is none.

    Parameters
    ----------
    pairs : sequence of MotionPair, each on its own clocks
    """
    sides = [p.reference for p in pairs], [p.observed for p in pairs]
    steps = [np.concatenate([np.empty(0), *(np.diff(m.time) for m in side)]) for side in sides]
    return max(float(np.median(one)) if one.size else np.inf for one in steps)


def _without_spikes(motion: Motion) -> Motion:
    """Leave out samples far from the median of their neighbours (Hampel's filter): a jump is no speed.

    A steady motion passes through the median of its window, so a fast one is not cut; only its ends are not looked at.
    """
    if len(motion) < SPIKE_WINDOW:
        return motion
    windows = sliding_window_view(motion.values, SPIKE_WINDOW, axis=0)
    distance = np.linalg.norm(windows - np.median(windows, axis=2, keepdims=True), axis=1)
    centre, spread = distance[:, SPIKE_WINDOW // 2], np.median(distance, axis=1)
    spike = (centre > SPIKE_SCALE * spread) & (centre > SPIKE_SCALE * np.quantile(centre, 0.8))
    keep = np.ones(len(motion), dtype=np.bool_)
    keep[SPIKE_WINDOW // 2 : -(SPIKE_WINDOW // 2)] = ~spike
    return motion.rows(keep)


def _speed_on_grid(motion: Motion, grid: FloatArray, width: float) -> FloatArray:
    """Speed `(g,)` on a uniform grid, low-passed by a Gaussian of `width` s; NaN outside and in gaps.

    The velocity is smoothed before its norm is taken, because a norm turns noise into speed.
    """
    if len(motion) < 2 or len(grid) < 2:
        return np.full(len(grid), np.nan)
    step = grid[1] - grid[0]
    columns = [np.interp(grid, motion.time, column) for column in motion.values.T]
    velocity = np.gradient(np.stack(columns, axis=1), step, axis=0)
    known = _supported(motion.time, grid, step)
    velocity[~known] = 0.0
    sigma = width / step
    support = gaussian_filter1d(known.astype(np.float64), sigma, mode="constant")
    smooth = gaussian_filter1d(velocity, sigma, axis=0, mode="constant") / np.maximum(support, 1e-12)[:, None]
    return np.where(known & (support >= MIN_SUPPORT), np.linalg.norm(smooth, axis=1), np.nan)


def _supported(time: FloatArray, grid: FloatArray, step: float) -> BoolArray:
    """Grid cells whose difference quotient lies within the motion and touches no gap."""
    gap = max(default_max_gap(time), 2 * step)
    after = np.clip(np.searchsorted(time, grid, side="right"), 1, len(time) - 1)
    inside = (grid >= time[0]) & (grid <= time[-1]) & (time[after] - time[after - 1] <= gap)
    known: BoolArray = inside.copy()
    known[1:] &= inside[:-1]
    known[:-1] &= inside[1:]
    return known


def lag_curve(pairs: Sequence[MotionPair], max_lag: float) -> LagCurve:
    """Correlation of observed speed at t + lag with reference speed at t, all pairs pooled.

    Each pair's means are taken out over the samples that both have at that lag, then covariances and
    variances are summed.

    Parameters
    ----------
    pairs : sequence of MotionPair, one a trajectory
    max_lag : float, largest lag tried either way, s
    """
    slow = slower_step(pairs)
    span = sum(float(p.reference.time[-1] - p.reference.time[0]) for p in pairs) + 2 * max_lag * len(pairs)
    step = max(slow / 2, MIN_STEP, span / MAX_CELLS)
    width = max(slow, MIN_WIDTH)
    reach = max(int(np.ceil(max_lag / step)), 2)
    sums, known = np.zeros((4, 2 * reach + 1)), []
    for pair in pairs:
        start, stop = pair.reference.time[0], pair.reference.time[-1]
        grid = start + step * np.arange(-reach, int((stop - start) / step) + reach + 1)
        reference = _speed_on_grid(pair.reference, grid, width)
        observed = _speed_on_grid(_without_spikes(pair.observed), grid, width)
        seen = observed[np.isfinite(observed)]
        if seen.size:
            observed = np.minimum(observed, CLIP * np.quantile(seen[seen >= np.median(seen)], 0.95))
        sums += _moments(reference, observed, reach)
        known.append(reference[np.isfinite(reference)])
    speed = np.concatenate(known)
    mean = float(speed.mean()) if speed.size else 0.0
    lags = np.linspace(-reach * step, reach * step, 2 * reach + 1)
    count, covariance, var_a, var_b = sums
    floor = 1e-12 * max(float(np.max(var_a * var_b)), np.finfo(float).tiny)
    usable = (count >= max(MIN_COMMON * float(np.max(count)), 3.0)) & (var_a * var_b > floor)
    coefficient: FloatArray = np.full(len(count), np.nan)
    coefficient[usable] = np.clip(covariance[usable] / np.sqrt(var_a[usable] * var_b[usable]), -1.0, 1.0)
    return LagCurve(lags, coefficient, float(speed.std()) / mean if mean > 0 else 0.0)


def _moments(a: FloatArray, b: FloatArray, reach: int) -> FloatArray:
    """Return counts, covariance sums and both variance sums at each lag `(4, 2 reach + 1)`."""
    known_a, known_b = np.isfinite(a), np.isfinite(b)
    if not known_a.any() or not known_b.any():
        return np.zeros((4, 2 * reach + 1))
    x = np.where(known_a, a - a[known_a].mean(), 0.0)  # centred first: sums of squares then lose no digits
    y = np.where(known_b, b - b[known_b].mean(), 0.0)
    m, k = known_a.astype(np.float64), known_b.astype(np.float64)
    count = np.round(_shifted(m, k, reach))
    n = np.maximum(count, 1.0)
    sum_x, sum_y = _shifted(x, k, reach), _shifted(m, y, reach)
    covariance = _shifted(x, y, reach) - sum_x * sum_y / n
    variances = _shifted(x**2, k, reach) - sum_x**2 / n, _shifted(m, y**2, reach) - sum_y**2 / n
    return np.stack([count, covariance, *variances])


def _shifted(a: FloatArray, b: FloatArray, reach: int) -> FloatArray:
    """Sum over t of a(t) b(t + lag) for lags -reach..reach."""
    n = next_fast_len(max(len(a), len(b)) + reach, real=True)  # so long that no lag within reach wraps around
    return np.asarray(irfft(rfft(b, n) * rfft(a, n).conj(), n)[np.arange(-reach, reach + 1)])


def peaks(curve: LagCurve) -> FloatArray:
    """Lags of the maxima that are high beside the highest, that one first, placed by a parabola each.

    Parameters
    ----------
    curve : LagCurve
    """
    r = np.where(np.isfinite(curve.correlation), curve.correlation, -np.inf)
    inner: IntArray = np.flatnonzero((r[1:-1] >= r[:-2]) & (r[1:-1] > r[2:]) & np.isfinite(r[:-2] + r[2:])) + 1
    if inner.size == 0:
        return np.empty(0)
    inner = inner[np.argsort(-r[inner], kind="stable")]
    inner = inner[r[inner] >= PEAK_SHARE * r[inner[0]]]
    left, top, right = r[inner - 1], r[inner], r[inner + 1]
    shift = 0.5 * (left - right) / np.minimum(left - 2 * top + right, -np.finfo(float).tiny)
    return np.asarray(curve.lags[inner] + np.clip(shift, -0.5, 0.5) * (curve.lags[1] - curve.lags[0]))
