"""How kernel and noise lie in one vector of unbounded numbers for the optimiser, with bounds and a weak prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Layout", "NoiseModel"]

SCALE_RANGE = (0.05, 100.0)  # length scales in spreads of a feature: shorter is noise, longer is no dependence
RATIO_RANGE = (1e-5, 1e4)  # noise to signal variance
ODDS = 6.0  # weights and shares stay within 0.25 % and 99.75 % of an even split
PRIOR_SPREAD = 2.0  # log units: a feature that does not matter drifts to a long scale, not to the bound
FIRST_RATIO, FIRST_SHARE_ODDS = 0.3, 0.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of each output relative to its signal.

    Parameters
    ----------
    ratio : (m,) array
        Noise variance over signal variance.
    share : (m,) array
        Share of the noise that is correlated in time, 0 to 1.
    time : float
        Correlation time, s.
    """

    ratio: FloatArray
    share: FloatArray
    time: float


@dataclass(frozen=True, eq=False)
class Layout:
    """Order of the parameters: log scales, log odds of the weights, log noise ratios, log odds of shares, log time.

    Parameters
    ----------
    masks : (c, d) bool array
        Which features each component sees.
    outputs : int
        Number of outputs m.
    correlated : bool
        Whether part of the noise is correlated; without it there are no shares and no time.
    time_range : (float, float) or None
        Shortest and longest correlation time, s; None when samples of a trajectory carry no times.
    """

    masks: BoolArray
    outputs: int
    correlated: bool = False
    time_range: tuple[float, float] | None = None

    @property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """Number of scales, weight odds, ratios, share odds and times."""
        shares = self.outputs if self.correlated else 0
        times = 1 if self.correlated and self.time_range is not None else 0
        return int(self.masks.sum()), len(self.masks) - 1, self.outputs, shares, times

    def _split(self, theta: FloatArray) -> list[FloatArray]:
        return np.split(theta, np.cumsum(self.sizes)[:-1])

    def kernel(self, theta: FloatArray) -> AdditiveRBF:
        """Return the correlation function that `theta` stands for."""
        log_scales, odds = self._split(theta)[:2]
        scales = np.full(self.masks.shape, np.inf)
        scales[self.masks] = np.exp(log_scales)
        weights = np.exp(np.append(odds, 0.0))
        return AdditiveRBF(weights / weights.sum(), scales)

    def noise(self, theta: FloatArray) -> NoiseModel:
        """Return the noise that `theta` stands for."""
        _, _, log_ratio, odds, log_time = self._split(theta)
        share = 1.0 / (1.0 + np.exp(-odds)) if odds.size else np.zeros(self.outputs)
        return NoiseModel(np.exp(log_ratio), share, float(np.exp(log_time[0])) if log_time.size else 1.0)

    def pack(
        self, by_scale: FloatArray, by_odds: FloatArray, by_ratio: FloatArray, by_share: FloatArray, by_time: float
    ) -> FloatArray:
        """Return the gradient `(p,)` in the order of the parameters, from full arrays over components and outputs."""
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
        usual: FloatArray = np.broadcast_to(per_component[:, None], self.masks.shape)[self.masks]
        return usual

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of each parameter for L-BFGS-B."""
        scales, odds, ratios, shares, times = self.sizes
        ranges = [SCALE_RANGE] * scales + [(np.exp(-ODDS), np.exp(ODDS))] * odds + [RATIO_RANGE] * ratios
        ranges += [(np.exp(-ODDS), np.exp(ODDS))] * shares + [self.time_range or (1.0, 1.0)] * times
        return [(float(np.log(low)), float(np.log(high))) for low, high in ranges]

    def penalty(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Negative log of a weak log-normal prior on the length scales, and its gradient."""
        count = self.sizes[0]
        z = (theta[:count] - self._usual_log_scales) / PRIOR_SPREAD
        gradient = np.zeros(len(theta))
        gradient[:count] = z / PRIOR_SPREAD
        return 0.5 * float(z @ z), gradient
