"""What of a residual is noise: white plus first-order autoregressive noise with heavy tails, in real time gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numba import njit
from scipy.ndimage import binary_opening, median_filter
from scipy.optimize import minimize, nnls
from scipy.stats import t as student

from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import BoolArray, FloatArray, IntArray

CORRELATION_TIMES = np.geomspace(0.02, 0.5, 20)  # s; longer ones would take motion effects for noise
NORMAL_MAD = 1.0 / MAD_TO_STD  # 0.6745: median of |z| of a standard normal
TAILS = (3.0, 4.0, 6.0, 10.0, np.inf)
MANY, BULK = 0.2, 0.99  # fraction of unchanged samples from which on a sensor rounds, and the fraction that is no fault
SPIKE_REACH = 3  # samples on either side


class NoiseSource(Enum):
    """What a channel's noise is taken from, as reports have it."""

    STATED = "[noise] of the model file"
    HOLDS = "holds"
    SHORT_LAGS = "changes over short lags (assumes that motion effects are smoother)"
    TOO_FEW = "too few samples; the smallest noise is assumed"


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel, in its unit."""

    white: float  # standard deviation of the part that is new at every sample
    slow: float  # of the autoregressive part
    time_constant: float  # correlation time of that, s
    tail: float = float("inf")  # degrees of freedom of Student's t that the whitened noise follows; infinite is normal
    source: NoiseSource = NoiseSource.STATED
    rounding_step: float | None = None  # in which the channel is written down, where that makes the noise
    times_stated: float | None = None  # of what the model states, where the recording is believed against it

    @property
    def std(self) -> float:
        """Standard deviation of a single sample, tails left out."""
        return float(np.hypot(self.white, self.slow))


def estimate_noise(
    time: FloatArray, residual: FloatArray, block: IntArray, still: BoolArray, floor: float = 1e-9
) -> ChannelNoise:
    """Estimate a channel's noise from how its residual changes over short time lags.

    Half the squared change over a lag h has the expectation w^2 + a^2 (1 - exp(-h / T)), plus c h^2 from what moves
    smoothly with the motion. Medians are used for it, so that rare jumps at reversals and outliers count little. Where
    nothing moves the three are then made most likely, each hold about a mean of its own.

    Parameters
    ----------
    time, residual, block : (n,) arrays
        Seconds, residual (NaN is missing), and block of each row, -1 for rows to leave out.
    still : (n,) bool array
        Rows at which nothing moved; where there are enough, only they are used, for there the residual is noise alone.
    floor : float, smallest standard deviation to return: resolution of the channel
    """
    usable = np.isfinite(residual) & (block >= 0)
    still = still & usable
    starts = still & ~np.r_[False, still[:-1] & (block[1:] == block[:-1])]
    holds = np.where(still, np.cumsum(starts) - 1, -1)  # a label per unbroken run of still rows in one block
    if (holds >= 0).sum() >= NOISE.min_pairs:
        label, source = holds, NoiseSource.HOLDS
    else:
        label, source = np.where(usable, block, -1), NoiseSource.SHORT_LAGS
    lags, halves = _structure(time, residual, label)
    if len(lags) == 0:
        return ChannelNoise(floor, 0.0, 1.0, source=NoiseSource.TOO_FEW)
    white, slow, time_constant = _fit_structure(lags, halves, floor)
    if source == NoiseSource.HOLDS:
        white, slow, time_constant = _most_likely(time, residual, holds, (white, slow, time_constant), floor)
    core = ChannelNoise(max(white, floor), slow, time_constant, source=source)
    rows = np.flatnonzero(label >= 0)
    return replace(core, tail=_tail(Whitener.of(core, time[rows], label[rows])(residual[rows, None])))


def _structure(time: FloatArray, residual: FloatArray, label: IntArray) -> tuple[FloatArray, FloatArray]:
    """Lags (s) and half the robust mean squared change over them."""
    inside = (label[1:] == label[:-1]) & (label[1:] >= 0)
    steps = np.diff(time)[inside]
    if len(steps) == 0:
        return np.zeros(0), np.zeros(0)
    longest = int(np.clip(NOISE.longest_lag / np.median(steps), 4, 400))
    lags, halves = [], []
    for lag in np.unique(np.geomspace(1, longest, 16).astype(int)):
        pair = (label[lag:] == label[:-lag]) & (label[lag:] >= 0)
        size = np.abs(residual[lag:] - residual[:-lag])[pair]
        size = size[np.isfinite(size)]
        if len(size) >= NOISE.min_pairs // 4:
            lags.append(np.median((time[lag:] - time[:-lag])[pair]))
            if np.mean(size == 0.0) < MANY:
                square = (np.median(size) / NORMAL_MAD) ** 2
            else:  # a sensor that rounds often shows no change: the bulk's mean is taken
                square = np.mean(size[size <= np.quantile(size, BULK)] ** 2)
            halves.append(square / 2)
    return np.array(lags), np.array(halves)


def _fit_structure(lags: FloatArray, halves: FloatArray, floor: float) -> tuple[float, float, float]:
    """White and slow standard deviation and time constant that fit the changes over the lags best."""
    weight = 1.0 / np.maximum(halves, floor**2)
    best, found = np.inf, (floor, 0.0, 1.0)
    for time_constant in CORRELATION_TIMES:
        columns = np.stack([np.ones(len(lags)), -np.expm1(-lags / time_constant), lags**2], axis=1)
        parts, misfit = nnls(columns * weight[:, None], halves * weight)
        if misfit < best:
            white, slow, _ = np.sqrt(parts)
            best, found = misfit, (float(white), float(slow), float(time_constant))
    return found


def _most_likely(
    time: FloatArray, residual: FloatArray, hold: IntArray, start: tuple[float, float, float], floor: float
) -> tuple[float, float, float]:
    """White, slow and time constant of largest restricted likelihood under Student's t, near a first estimate.

    Each hold has a mean of its own (what is missing in the model is constant there), which costs a number each:
    Patterson and Thompson 1971, Biometrika 58(3).
    """
    rows = np.flatnonzero(hold >= 0)
    t, block = time[rows], np.unique(hold[rows], return_inverse=True)[1]
    values = np.stack([residual[rows], np.ones(len(rows))], axis=1)
    scale = max(float(np.hypot(*start[:2])), floor)
    low = np.log([max(0.02 * scale, floor), 0.02 * scale, CORRELATION_TIMES[0]])
    high = np.log([3.0 * scale, 3.0 * scale, CORRELATION_TIMES[-1]])
    if (low >= high).any():
        return start

    def cost(p: FloatArray) -> float:
        whitener = Whitener.of(ChannelNoise(*np.exp(np.clip(p, low, high))), t, block)
        z, ones = whitener(values).T
        energy = np.bincount(block, ones**2)
        left = z - (np.bincount(block, ones * z) / energy)[block] * ones
        tails = 0.5 * (NOISE.likely_tail + 1.0) * np.log1p(left**2 / (NOISE.likely_tail - 2.0)).sum()
        return float(tails + np.log(whitener.scale).sum() + 0.5 * np.log(energy).sum())

    first = np.clip(np.log(np.maximum(start, 1e-300)), low, high)
    found = minimize(cost, first, method="Nelder-Mead", options={"maxiter": 120, "xatol": 0.02, "fatol": 0.05})
    white, slow, time_constant = np.exp(np.clip(found.x, low, high))
    return float(white), float(slow), float(time_constant)


def _tail(z: FloatArray) -> float:
    """Degrees of freedom whose ratio of 98th percentile to median of |z| is nearest the observed one."""
    if len(z) < NOISE.min_pairs:
        return float("inf")
    low, high = np.quantile(np.abs(z), [0.5, 0.98])
    ratios = [student.ppf(0.99, nu) / student.ppf(0.75, nu) for nu in TAILS]
    return TAILS[int(np.argmin(np.abs(np.log(ratios) - np.log(max(high, 1e-300) / max(low, 1e-300)))))]


@dataclass(frozen=True, eq=False)
class Whitener:
    """Turns columns that carry a noise into columns of independent noise of unit variance.

    Innovations of the Kalman filter of the noise model, started afresh in every block; linear in the columns, gaps
    count in real time.
    """

    block: IntArray  # (n,) of each row
    gain: FloatArray  # (n,) of the Kalman filter
    scale: FloatArray  # (n,) standard deviation of the innovation
    phi: FloatArray  # (n,) correlation with the sample before

    @classmethod
    def of(cls, noise: ChannelNoise, time: FloatArray, block: IntArray) -> Whitener:
        """Prepare the filter.

        Parameters
        ----------
        noise : ChannelNoise
        time : (n,) array, s
        block : (n,) int array, of each row, from 0
        """
        return cls(block, *_filter(time, block, noise.white, noise.slow, noise.time_constant))

    def __call__(self, values: FloatArray, weight: float | FloatArray = 1.0) -> FloatArray:
        """Return whitened columns of columns `(n, k)`, by the weight of each row."""
        return _innovations(values, self.block, self.gain, weight / self.scale, self.phi)


@njit(cache=True)
def _filter(
    time: FloatArray, block: IntArray, white: float, slow: float, time_constant: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kalman gain, deviation of the innovation, and correlation with the sample before, of each row `(n,)`."""
    n = len(block)
    gain, scale, phi = np.zeros(n), np.ones(n), np.zeros(n)
    n_blocks = block.max() + 1 if n else 0
    variance, last = np.full(n_blocks, slow**2), np.full(n_blocks, -1)
    for i, b in enumerate(block):
        if last[b] >= 0:
            phi[i] = np.exp(-max(time[i] - time[last[b]], 0.0) / time_constant)
        predicted = phi[i] ** 2 * variance[b] + slow**2 * (1.0 - phi[i] ** 2)
        total = predicted + white**2
        gain[i], scale[i] = predicted / total, np.sqrt(total)
        variance[b] = (1.0 - gain[i]) * predicted
        last[b] = i
    return gain, scale, phi


@njit(cache=True)
def _innovations(
    values: FloatArray, block: IntArray, gain: FloatArray, size: FloatArray, phi: FloatArray
) -> FloatArray:
    """Run the filter over every column, and return its innovations, scaled; each block has its own state."""
    white, state = np.empty(values.shape), np.zeros((block.max() + 1 if len(block) else 0, values.shape[1]))
    for i, b in enumerate(block):
        for j in range(values.shape[1]):
            predicted = phi[i] * state[b, j]
            surprise = values[i, j] - predicted
            white[i, j] = surprise * size[i]
            state[b, j] = predicted + gain[i] * surprise
    return white


def outliers(residual: FloatArray, block: IntArray) -> BoolArray:
    """Mark single samples far from the running median of their neighbours: faults of a sensor, not of the machine.

    What stands among more than a few in a row is a machine that was pushed aside.

    Parameters
    ----------
    residual : (n,) array, rad or m; NaN is missing
    block : (n,) int array, trajectory of each row, from 0 without gaps; -1 for rows to leave out
    """
    spikes = np.zeros(len(residual), dtype=np.bool_)
    window = 2 * SPIKE_REACH + 1
    for k in np.unique(block[block >= 0]):
        rows = np.flatnonzero((block == k) & np.isfinite(residual))
        if len(rows) < 4 * window:
            continue
        distance = np.abs(residual[rows] - median_filter(residual[rows], window, mode="nearest"))
        off = distance[distance > 0.0]  # one in a window is its median; more only where a sensor rounds
        rounds = len(off) and 1.0 - len(off) / len(rows) > MANY + 1.0 / window
        scale = np.median(off if rounds else distance) / NORMAL_MAD
        around = median_filter(distance, window, mode="nearest")
        far = (distance > NOISE.spike * max(scale, 1e-300)) & (distance > 3 * around)
        spikes[rows] = far & ~binary_opening(far, np.ones(NOISE.longest_spike + 1))
    return spikes
