"""Marginal likelihood of several outputs that share one correlation function, with analytic gradients.

Output o has covariance `s_o (R + nu_o [(1 - phi_o) I + phi_o E])`: R the correlation over inputs, shared; nu_o the
noise-to-signal ratio; phi_o the share of the noise that is correlated in time, `E_ij = exp(-|t_i - t_j| / T)` inside
one trajectory and zero between two. The signal variance s_o sits at its best for all else, `s_o = y^T C^-1 y / n`, so
by the envelope theorem the gradient is `dL = sum_o tr[(C_o^-1 - a_o a_o^T / s_o) dC_o] / 2` with `a_o = C_o^-1 y_o`
(Rasmussen and Williams 2006, Eq. 5.9).

Without E, whatever pose and velocity do not explain but neighbouring samples share (hysteresis, drift) is taken for a
fine-grained field: length scales and noise come out far too small, and intervals are not honest (docs/design/0002).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from gpcorrect.gpr.kernels import AdditiveRBF, Kernel
from gpcorrect.gpr.linalg import inverse_and_log_determinant
from gpcorrect.types import BoolArray, FloatArray, IntArray

SCALE_RANGE = (0.05, 100.0)  # length scales in spreads of a feature: shorter is noise, longer is no dependence
RATIO_RANGE = (1e-5, 1e4)  # noise to signal variance
ODDS = 6.0  # weights and shares stay within 0.25 % and 99.75 % of an even split
PRIOR_SPREAD = 2.0  # log units: a feature that does not matter drifts to a long scale, not to the bound
FIRST_RATIO, FIRST_SHARE_ODDS = 0.3, 0.0
TINY = 1e-12  # a constant output has no signal, and log(0) must not be taken


@dataclass(frozen=True, eq=False)
class _NoiseModel:
    """Noise of each output relative to its signal."""

    ratio: FloatArray  # (m,) noise variance over signal variance
    share: FloatArray  # (m,) share of the noise that is correlated in time, 0 to 1
    time: float  # correlation time, s


@dataclass(frozen=True, eq=False)
class Layout:
    """Order of the parameters: log scales, log odds of the weights, log noise ratios, log odds of shares, log time."""

    masks: BoolArray  # (c, d) which features each component sees
    outputs: int  # number of outputs m
    correlated: bool = False  # whether part of the noise is correlated; without it there are no shares and no time
    # (float, float) shortest and longest correlation time, s; None when samples of a trajectory carry no times
    time_range: tuple[float, float] | None = None
    kind: type[Kernel] = AdditiveRBF  # which the scales and weights belong to

    @property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """Number of scales, weight odds, ratios, share odds and times."""
        shares = self.outputs if self.correlated else 0
        times = 1 if self.correlated and self.time_range is not None else 0
        return int(self.masks.sum()), len(self.masks) - 1, self.outputs, shares, times

    def _split(self, theta: FloatArray) -> list[FloatArray]:
        return np.split(theta, np.cumsum(self.sizes)[:-1])

    def kernel(self, theta: FloatArray) -> Kernel:
        """Return the correlation function that `theta` stands for.

        Parameters
        ----------
        theta : (p,) array
        """
        log_scales, odds = self._split(theta)[:2]
        scales = np.full(self.masks.shape, np.inf)
        scales[self.masks] = np.exp(log_scales)
        weights = np.exp(np.append(odds, 0.0))
        return self.kind(weights / weights.sum(), scales)

    def noise(self, theta: FloatArray) -> _NoiseModel:
        """Return the noise that `theta` stands for.

        Parameters
        ----------
        theta : (p,) array
        """
        _, _, log_ratio, odds, log_time = self._split(theta)
        share = 1.0 / (1.0 + np.exp(-odds)) if odds.size else np.zeros(self.outputs)
        return _NoiseModel(np.exp(log_ratio), share, float(np.exp(log_time[0])) if log_time.size else 1.0)

    def pack(
        self, by_scale: FloatArray, by_odds: FloatArray, by_ratio: FloatArray, by_share: FloatArray, by_time: float
    ) -> FloatArray:
        """Return the gradient `(p,)` in the order of the parameters, from full arrays over components and outputs.

        Parameters
        ----------
        by_scale, by_odds : (c, d) and (c,) arrays, by log length scales and log odds of the weights
        by_ratio, by_share : (m,) arrays, by log noise ratios and log odds of the correlated noise
        by_time : float, by the log correlation time
        """
        _, _, _, shares, times = self.sizes
        return np.concatenate(
            [by_scale[self.masks], by_odds[:-1], by_ratio, by_share[:shares], np.full(times, by_time)]
        )

    @property
    def start(self) -> FloatArray:
        """Where the first search begins: the length scale of a component grows with the root of its features."""
        _, odds, ratios, shares, times = self.sizes
        time = np.log(self.time_range).mean() if self.time_range is not None else 0.0
        return np.concatenate(
            [
                self._usual_log_scales,
                np.zeros(odds),
                np.full(ratios, np.log(FIRST_RATIO)),
                np.full(shares, FIRST_SHARE_ODDS),
                np.full(times, time),
            ]
        )

    @property
    def _usual_log_scales(self) -> FloatArray:
        per_component = 0.5 * np.log(np.maximum(self.masks.sum(axis=1), 1))
        return np.broadcast_to(per_component[:, None], self.masks.shape)[self.masks]

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of each parameter for L-BFGS-B."""
        scales, odds, ratios, shares, times = self.sizes
        ranges = [SCALE_RANGE] * scales + [(np.exp(-ODDS), np.exp(ODDS))] * odds + [RATIO_RANGE] * ratios
        ranges += [(np.exp(-ODDS), np.exp(ODDS))] * shares + [self.time_range or (1.0, 1.0)] * times
        return [(float(np.log(low)), float(np.log(high))) for low, high in ranges]

    def penalty(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Negative log of a weak log-normal prior on the length scales, and its gradient.

        Parameters
        ----------
        theta : (p,) array
        """
        count = self.sizes[0]
        z = (theta[:count] - self._usual_log_scales) / PRIOR_SPREAD
        gradient = np.zeros(len(theta))
        gradient[:count] = z / PRIOR_SPREAD
        return 0.5 * float(z @ z), gradient


class Lags(NamedTuple):
    """Pairs of samples of one trajectory: places in the upper triangle `(k,)`, row by row, and seconds between `(k,)`.

    E is one on its diagonal and zero elsewhere, so that a recording of many trajectories costs little.
    """

    places: IntArray
    seconds: FloatArray


@dataclass(frozen=True, eq=False)
class LearningData:
    """What the likelihood is taken of."""

    X: FloatArray  # (n, d) inputs of unit spread
    Y: FloatArray  # (n, m) centred outputs of unit spread
    lags: Lags  # between samples of one trajectory; none for white noise


def sample_lags(groups: IntArray | None, times: FloatArray | None) -> Lags:
    """Return the pairs of samples of one group, zero seconds apart when there are no times.

    Parameters
    ----------
    groups : (n,) array or None, group of each sample; None for no pairs
    times : (n,) array or None, seconds
    """
    if groups is None:
        return Lags(np.zeros(0, dtype=np.int64), np.zeros(0))
    first, second = np.nonzero(np.triu(groups[:, None] == groups, k=1))
    seconds = np.zeros(len(first)) if times is None else np.abs(times[first] - times[second])
    return Lags(first * len(groups) + second, seconds)


def negative_log_posterior(theta: FloatArray, data: LearningData, layout: Layout) -> tuple[float, FloatArray]:
    """Negative log marginal likelihood up to a constant, summed over outputs, plus the prior's penalty; its gradient.

    Parameters
    ----------
    theta : (p,) array, in the order of `layout`
    data : LearningData
    layout : Layout
    """
    kernel, noise = layout.kernel(theta), layout.noise(theta)
    R, pullback = kernel.with_gradient(data.X)
    E = np.exp(-data.lags.seconds / noise.time)
    value, by_R, by_ratio, by_share, by_E = _outputs(data, R, E, noise)
    by_odds = by_share * noise.share * (1.0 - noise.share)
    gradient = layout.pack(*pullback(by_R), by_ratio, by_odds, float(by_E @ (E * data.lags.seconds)) / noise.time)
    penalty, penalty_gradient = layout.penalty(theta)
    return value + penalty, gradient + penalty_gradient


def profiled_signal(theta: FloatArray, data: LearningData, layout: Layout) -> FloatArray:
    """Best signal variance `(m,)` of each output for given parameters.

    Parameters
    ----------
    theta, data, layout
        As for :func:`negative_log_posterior`.
    """
    kernel, noise = layout.kernel(theta), layout.noise(theta)
    R, E = kernel(data.X, data.X), np.exp(-data.lags.seconds / noise.time)
    signal = []
    for o, y in enumerate(data.Y.T):
        inverse, _ = inverse_and_log_determinant(_covariance(R, data.lags, E, noise, o))
        signal.append(float(y @ blas.dsymv(1.0, inverse.T, y, lower=1)) / len(y))
    return np.maximum(signal, TINY)


def _covariance(R: FloatArray, lags: Lags, E: FloatArray, noise: _NoiseModel, output: int) -> FloatArray:
    """Covariance over signal variance in the upper triangle."""
    C = np.array(R)
    C[np.diag_indices_from(C)] += noise.ratio[output]
    C.reshape(-1)[lags.places] += noise.ratio[output] * noise.share[output] * E
    return C


def _outputs(
    data: LearningData, R: FloatArray, E: FloatArray, noise: _NoiseModel
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sum the likelihood over outputs, and its slopes by R (an upper triangle), log ratios, shares and E."""
    n, m = data.Y.shape
    value, by_ratio, by_share, by_E = 0.0, np.zeros(m), np.zeros(m), np.zeros(len(E))
    by_R = np.zeros((n, n))
    for o, y in enumerate(data.Y.T):
        ratio, share = float(noise.ratio[o]), float(noise.share[o])
        inverse, log_determinant = inverse_and_log_determinant(_covariance(R, data.lags, E, noise, o))
        a = blas.dsymv(1.0, inverse.T, y, lower=1)
        signal = max(float(y @ a) / n, TINY)
        value += 0.5 * (n * np.log(signal) + log_determinant)
        slope = blas.dsyr(-1.0 / signal, a, a=inverse.T, lower=1, overwrite_a=1).T  # C^-1 - a a^T / s
        pairs = slope.reshape(-1)[data.lags.places]
        inner = float(pairs @ E)
        by_ratio[o] = ratio * (0.5 * float(np.trace(slope)) + share * inner)
        by_share[o] = ratio * inner
        by_E += ratio * share * pairs
        by_R += slope
    return value, by_R, by_ratio, by_share, by_E
