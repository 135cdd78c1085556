"""Sensor noise as it is: white with heavy tails, slow, with outliers and holes; and how it may be worse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

PHI = 0.95
OUTLIERS, OUTLIER_SIZE = 0.002, (8.0, 25.0)  # share of samples, in standard deviations
HOLES, HOLE_SAMPLES = 0.0006, (1, 12)  # begun a sample, and how long


@dataclass(frozen=True, eq=False)
class NoiseLaw:
    """Standard deviations `(k,)` of the white and the slow part of each channel, and the law's shape."""

    white: Array
    slow: Array
    phi: float = PHI
    degrees: float = 6.0
    awkward: str = ""

    @property
    def rms(self) -> Array:
        """RMS `(k,)` of the noise without outliers."""
        return np.hypot(self.white, self.slow)

    def times(self, factor: float) -> NoiseLaw:
        """Return the same law, louder or softer."""
        return NoiseLaw(self.white * factor, self.slow * factor, self.phi, self.degrees, self.awkward)


def draw_noise(rng: np.random.Generator, typical: Array, awkward: str) -> NoiseLaw:
    """Draw a law about typical white parts `(k,)`."""
    white = typical * np.exp(rng.uniform(np.log(0.6), np.log(1.6), len(typical)))
    slow = white * rng.uniform(0.3, 0.9, len(typical))
    phi = 0.995 if awkward == "slow" else PHI
    degrees = 2.6 if awkward == "heavy_tails" else float(rng.uniform(4.5, 10.0))
    return NoiseLaw(white, slow * (1.8 if awkward == "slow" else 1.0), phi, degrees, awkward)


def noise_of(
    law: NoiseLaw, rng: np.random.Generator, trajectory: NDArray[np.int64], speed: Array, extra: Array
) -> Array:
    """Noise `(n, k)`, NaN in the holes.

    Parameters
    ----------
    law : NoiseLaw, k channels
    rng : numpy.random.Generator, chance
    trajectory : (n,) int array, the slow part begins anew with each
    speed : (n,) array, of the motion, as a share of its greatest
    extra : (n, k) array, standard deviation of further white noise, in the unit of the channels
    """
    n, k = len(trajectory), len(law.white)
    tails = rng.standard_t(law.degrees, (n, k)) / np.sqrt(law.degrees / (law.degrees - 2.0))
    slow = _slow(law.phi, rng, trajectory, k)
    noise = (law.white * tails + law.slow * slow) * _loudness(law.awkward, rng, trajectory, speed)[:, None]
    noise = noise + extra * rng.standard_normal((n, k))
    spikes = rng.random((n, k)) < OUTLIERS
    size = rng.uniform(*OUTLIER_SIZE, (n, k)) * rng.choice([-1.0, 1.0], (n, k))
    noise = np.where(spikes, noise + size * law.rms, noise)
    noise[_holes(rng, n, 8.0 if law.awkward == "dropouts" else 1.0)] = np.nan
    return noise


def _slow(phi: float, rng: np.random.Generator, trajectory: NDArray[np.int64], k: int) -> Array:
    """Autoregression `(n, k)` of unit deviation, begun anew with each trajectory."""
    drive = rng.standard_normal((len(trajectory), k))
    for number in np.unique(trajectory):
        rows = np.flatnonzero(trajectory == number)
        drive[rows[1:]] *= np.sqrt(1.0 - phi**2)
        drive[rows] = lfilter([1.0], [1.0, -phi], drive[rows], axis=0)
    return drive


def _loudness(awkward: str, rng: np.random.Generator, trajectory: NDArray[np.int64], speed: Array) -> Array:
    """How much louder the noise is at each sample."""
    if awkward == "uneven":
        return np.exp(0.5 * rng.standard_normal(int(trajectory.max()) + 1))[trajectory]
    if awkward == "fast_noisy":
        return 0.6 + 2.0 * speed
    return np.ones(len(trajectory))


def _holes(rng: np.random.Generator, n: int, often: float) -> NDArray[np.bool_]:
    hole = np.zeros(n, dtype=np.bool_)
    for start in np.flatnonzero(rng.random(n) < HOLES * often):
        hole[start : start + int(rng.integers(*HOLE_SAMPLES))] = True
    return hole
