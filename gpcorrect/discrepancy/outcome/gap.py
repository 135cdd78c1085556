"""How much the named effects explain, on the part that nothing was fitted to.

Before, after, noise, placebo and black-box ceiling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray, IntArray

__all__ = ["GapFigures", "closed_gap", "gap_figures", "rms"]

DRAWS = 1000


@dataclass(frozen=True)
class GapFigures:
    """One channel on the sealed part, in its unit.

    Parameters
    ----------
    before, after, noise : float
        Root mean squares of the residual without and with the effects, and of noise alone.
    p95, largest : pairs of float
        95th percentile and maximum of the absolute residual, before and after.
    closed : float
        1 - (after^2 - noise^2) / (before^2 - noise^2); NaN where there is no gap to close.
    closed_ci95 : pair of float
        Bootstrap over trajectories.
    """

    before: float
    after: float
    noise: float
    p95: tuple[float, float]
    largest: tuple[float, float]
    closed: float
    closed_ci95: tuple[float, float]


def rms(values: FloatArray) -> float:
    """Root mean square of the finite values; NaN when there is none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")


def closed_gap(before: float | FloatArray, after: float | FloatArray, noise: float) -> FloatArray:
    """Share of the mean square beyond noise that is gone; NaN where there was none."""
    gap = np.asarray(before, dtype=np.float64) ** 2 - noise**2
    left = np.asarray(after, dtype=np.float64) ** 2 - noise**2
    share: FloatArray = np.where(gap > 0, 1.0 - left / np.where(gap > 0, gap, 1.0), np.nan)
    return share


def gap_figures(
    before: FloatArray, after: FloatArray, noise: float, block: IntArray, rng: np.random.Generator
) -> GapFigures:
    """Figures of one channel.

    Parameters
    ----------
    before, after : (n,) arrays
        Residuals of the sealed rows; NaN is missing.
    noise : float
        Standard deviation of the channel's noise.
    block : (n,) int array
        Trajectory of each row: the bootstrap draws whole ones.
    rng : numpy.random.Generator
        Draws.
    """
    good = np.isfinite(before) & np.isfinite(after)
    before, after = before[good], after[good]
    if len(before) == 0:
        nan = float("nan")
        return GapFigures(nan, nan, noise, (nan, nan), (nan, nan), nan, (nan, nan))
    _, index = np.unique(block[good], return_inverse=True)
    count = np.bincount(index)
    sums = np.bincount(index, before**2), np.bincount(index, after**2)
    draw = rng.integers(len(count), size=(DRAWS, len(count)))
    total = count[draw].sum(axis=1)
    drawn = closed_gap(np.sqrt(sums[0][draw].sum(axis=1) / total), np.sqrt(sums[1][draw].sum(axis=1) / total), noise)
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.quantile(drawn, [0.025, 0.975]) if len(drawn) else (np.nan, np.nan)
    sizes = np.abs(before), np.abs(after)
    return GapFigures(
        before=rms(before),
        after=rms(after),
        noise=noise,
        p95=(float(np.percentile(sizes[0], 95)), float(np.percentile(sizes[1], 95))),
        largest=(float(sizes[0].max()), float(sizes[1].max())),
        closed=float(closed_gap(rms(before), rms(after), noise)),
        closed_ci95=(float(low), float(high)),
    )
