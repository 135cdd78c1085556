"""Where simulation and measurement disagree: the small tests that beat the largest of them in noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.linear import fold_of, grams, held_out_nats, solve
from gpcorrect.discrepancy.evidence.tones import strongest_tone
from gpcorrect.discrepancy.evidence.variables import Cells, Quantity, Span, Variable
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise, Whitener
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import FloatArray, IntArray

SHOWN = 5  # findings of a channel


@dataclass(frozen=True, eq=False)
class ChannelData:
    """One channel as the tests, `cells`, see it: time (s), residual (NaN is missing) and its noise.

    `block` `(n,)` numbers whole trajectories from 0 without gaps, -1 for rows to leave out. Findings of less than
    `least` times the noise do not count.
    """

    channel: Channel
    time: FloatArray
    residual: FloatArray
    block: IntArray
    noise: ChannelNoise
    cells: Sequence[Cells]
    least: float = 0.0


@dataclass(frozen=True)
class Finding:
    """A test that noise cannot explain: what the residual depends on, and the cell in which it is largest.

    `nats` are gained on held-out trajectories. `size` is the root mean square of what depends on the variables, as a
    fraction of the noise, and `counts` whether that is large enough to matter.
    """

    channel: Channel
    variables: tuple[Variable, ...]
    region: tuple[Span, ...]
    nats: float
    size: float
    counts: bool = True


@dataclass(frozen=True)
class Equivalence:
    """Upper 95 % bound of a channel's systematic part, as a fraction of its noise, and the bound it has to be under."""

    channel: Channel
    upper: float
    limit: float

    @property
    def shown(self) -> bool:
        """Whether the systematic part is shown to be too small to matter."""
        return self.upper < self.limit


@dataclass(frozen=True)
class Localisation:
    """Outcome of all tests: the findings above the threshold, largest first, those too small to count as well.

    The largest of all tests stays below the threshold in noise, with the level's probability; `largest` are the nats of
    the best test whose finding counts.
    """

    findings: tuple[Finding, ...]
    threshold: float
    largest: float
    equivalence: tuple[Equivalence, ...]

    @property
    def something(self) -> bool:
        """Whether anything beats noise."""
        return self.largest > self.threshold

    @property
    def worth_a_search(self) -> bool:
        """Whether anything beats noise, be it too small to count: a name may still be sure."""
        return bool(self.findings)

    @property
    def nothing(self) -> bool:
        """Whether nothing beats noise and every channel's systematic part is shown to be too small to matter."""
        return not self.something and all(e.shown for e in self.equivalence)


def localise(
    channels: Sequence[ChannelData], rng: np.random.Generator, *, draws: int, tolerance: float = 0.0
) -> Localisation:
    """Run every test of every channel, and the null law of the largest of them by parametric bootstrap from the noise.

    Parameters
    ----------
    channels : sequence of ChannelData
    rng : numpy.random.Generator, draws the bootstrap
    draws : int, bootstrap samples
    tolerance : float, of the task, rad or m; the equivalence limit is the larger of it and a quarter of the noise
    """
    findings: list[Finding] = []
    bounds: list[Equivalence] = []
    largest, null = 0.0, np.full(draws, -np.inf)
    tested = [c for c in channels if (c.block >= 0).any()]
    for data in tested:
        found, null_nats, upper = _test_channel(data, rng, draws)
        findings += found[:SHOWN]
        null = np.maximum(null, null_nats)
        best = found[0].nats if found and found[0].counts else -np.inf
        largest = max(largest, best) if bounds else best
        bounds.append(Equivalence(data.channel, upper, max(TESTS.equivalence, tolerance / data.noise.std)))
    threshold = max(0.0, _quantile_of_largest(null, TESTS.level)) if tested else 0.0
    above = sorted((f for f in findings if f.nats > threshold), key=_rank)
    return Localisation(tuple(above), threshold, largest, tuple(bounds))


def _quantile_of_largest(null: FloatArray, level: float) -> float:
    """Return a quantile of a maximum of many: of the Gumbel law with the draws' mean and standard deviation.

    Its 99 % quantile from 60 draws is as sure (half a standard deviation) as the third largest of 300 (Gumbel 1958,
    Statistics of Extremes, Sec. 6.2).
    """
    scale = float(np.std(null)) * np.sqrt(6.0) / np.pi
    return float(np.mean(null) - scale * (np.euler_gamma + np.log(-np.log(level))))


def _rank(finding: Finding) -> tuple[bool, float]:
    return not finding.counts, -finding.nats


def _test_channel(data: ChannelData, rng: np.random.Generator, draws: int) -> tuple[list[Finding], FloatArray, float]:
    """Return all findings, the best first, the largest nats in each draw of noise, and how large the rest may be."""
    rows = np.flatnonzero((data.block >= 0) & np.isfinite(data.residual))
    fold = fold_of(int(data.block[rows].max()) + 1)[data.block[rows]]
    order = np.argsort(fold, kind="stable")  # evidence is summed over whole folds
    rows, fold = rows[order], fold[order]
    whitener = Whitener.of(data.noise, data.time[rows], data.block[rows])
    z = _clipped(whitener(data.residual[rows, None]))
    both = np.concatenate([z, _clipped(_noise(data.noise.tail, (len(rows), draws), rng))[order]], axis=1)
    std = data.noise.std
    precision = 1.0 / (TESTS.prior_std * max(float(np.sqrt(np.mean(data.residual[rows] ** 2))), std)) ** 2
    null = np.full(draws, -np.inf)
    found, systematic = [], 0.0
    for cells in data.cells:
        columns = cells.indicator(rows)
        sums = grams(whitener(columns), both, fold)
        gains = held_out_nats(sums, np.arange(len(sums.gram)), precision).sum(axis=0)
        null = np.maximum(null, gains[1:])
        gram, moment = sums.gram.sum(axis=0), sums.moment[:, :, 0].sum(axis=0)
        alone = len(cells.variables) == 1
        size, upper = _systematic(gram, moment, columns.mean(axis=0), rng if alone else None)
        systematic = max(systematic, upper)
        region = cells.spans[int(np.argmax(solve(gram, moment) ** 2 * np.diag(gram)))]
        counts = size / std >= data.least
        found.append(Finding(data.channel, cells.variables, region, float(gains[0]), size / std, counts))
    tone = strongest_tone(data.time, data.residual, data.block)
    if tone is not None and tone.nats >= TESTS.sure_tone and tone.rms >= TESTS.equivalence * std:
        frequency = Variable(Quantity.FREQUENCY)
        region = (Span(frequency, tone.low, tone.high, "Hz"),)
        found.append(Finding(data.channel, (frequency,), region, tone.nats, tone.rms / std))
        systematic = max(systematic, tone.rms)
    return sorted(found, key=_rank), null, systematic / std


def _noise(tail: float, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Independent draws with the whitened noise's tails; their median of |z| is that of a normal."""
    if np.isinf(tail):
        return rng.standard_normal(shape)
    draws: FloatArray = rng.standard_t(tail, shape) * (NORMAL_MAD / student.ppf(0.75, tail))
    return draws


def _clipped(z: FloatArray) -> FloatArray:
    """Whitened residuals with the far tails pulled in to some robust deviations of their column."""
    limit = TESTS.clip * np.maximum(1.0, MAD_TO_STD * np.median(np.abs(z), axis=0))
    return np.clip(z, -limit, limit)


def _systematic(
    gram: FloatArray, moment: FloatArray, fraction: FloatArray, rng: np.random.Generator | None
) -> tuple[float, float]:
    """Root mean square of a cell-wise constant part, spread between trajectories included, and its upper 95 % bound.

    The estimate's scatter is taken off. `fraction` of the rows is in each cell. Without a generator, which draws from
    the posterior, the bound is 0.
    """
    occupied = np.diag(gram) > 1e-9 * np.diag(gram).max()
    covariance = np.linalg.pinv(gram[np.ix_(occupied, occupied)], hermitian=True)
    beta, scatter = covariance @ moment[occupied], np.diag(covariance)
    fraction = fraction[occupied] / fraction[occupied].sum()
    size = float(np.sqrt(max(0.0, float(fraction @ (beta**2 - scatter)))))
    if rng is None:
        return size, 0.0
    # Posterior draws scatter once more than the estimate did; that scatter taken off twice leaves the true part.
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(beta)))
    scattered = beta[:, None] + root @ rng.standard_normal((len(beta), 400))
    squares = fraction @ scattered**2 - 2 * float(fraction @ scatter)
    return size, float(np.sqrt(max(0.0, np.quantile(squares, 0.95))))
