"""Where simulation and measurement disagree.

The small tests whose held-out gain beats what noise alone would give in the largest of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.linear import Grams, fold_of, grams, held_out_nats, solve
from gpcorrect.discrepancy.evidence.tones import strongest_tone
from gpcorrect.discrepancy.evidence.variables import Cells, Quantity, Span, Variable
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.noise import ChannelNoise, Whitener, standard_draws
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import FloatArray, IntArray

SHOWN = 5  # findings of a channel


@dataclass(frozen=True, eq=False)
class ChannelData:
    """One channel as the tests see it.

    Parameters
    ----------
    channel : Channel
        Which one.
    time, residual : (n,) arrays
        Seconds, and measured minus simulated; NaN is missing.
    block : (n,) int array
        Whole trajectories from 0 without gaps; -1 for rows to leave out.
    noise : ChannelNoise
        Of the residual.
    cells : sequence of Cells
        The tests.
    least : float
        Size below which a finding does not count, as a fraction of the noise.
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
    """A test that noise cannot explain.

    Parameters
    ----------
    channel : Channel
        Where.
    variables : tuple of Variable
        What the residual depends on.
    region : tuple of Span
        The cell in which it is largest.
    nats : float
        Gain of log-likelihood on held-out trajectories.
    size : float
        Root mean square of what depends on the variables, as a fraction of the noise.
    counts : bool
        Whether it is large enough to matter.
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
    """Outcome of all tests.

    Parameters
    ----------
    findings : tuple of Finding
        Above the threshold, largest first; those too small to count as well.
    threshold : float
        Nats that the largest of all tests stays below in noise, with the level's probability.
    largest : float
        Nats of the best test whose finding counts.
    equivalence : tuple of Equivalence
        Of each channel.
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
    channels: Sequence[ChannelData],
    rng: np.random.Generator,
    *,
    draws: int,
    tolerance: float = 0.0,
) -> Localisation:
    """Run every test of every channel, and the null law of the largest of them by parametric bootstrap from the noise.

    Parameters
    ----------
    channels : sequence of ChannelData
        What to test.
    rng : numpy.random.Generator
        Draws the bootstrap.
    draws : int
        Bootstrap samples.
    tolerance : float
        Of the task, rad or m; the equivalence limit is the larger of it and a quarter of the noise.
    """
    results = [_test_channel(c, rng, draws) for c in channels if (c.block >= 0).any()]
    if not results:
        return Localisation((), 0.0, 0.0, ())
    null = np.max([r.null for r in results], axis=0)
    threshold = max(0.0, _quantile_of_largest(null, TESTS.level))
    findings = sorted((f for r in results for f in r.findings if f.nats > threshold), key=_rank)
    largest = max(r.largest for r in results)
    bounds = []
    for r in results:
        std = r.data.noise.std
        bounds.append(Equivalence(r.data.channel, r.systematic / std, max(TESTS.equivalence, tolerance / std)))
    return Localisation(tuple(findings), threshold, largest, tuple(bounds))


def _quantile_of_largest(null: FloatArray, level: float) -> float:
    """Return a quantile of a maximum of many: of the Gumbel law with the draws' mean and standard deviation.

    Its 99 % quantile from 60 draws is as sure (half a standard deviation) as the third largest of 300 (Gumbel 1958,
    Statistics of Extremes, Sec. 6.2).
    """
    scale = float(np.std(null)) * np.sqrt(6.0) / np.pi
    return float(np.mean(null) - scale * (np.euler_gamma + np.log(-np.log(level))))


def _rank(finding: Finding) -> tuple[bool, float]:
    return not finding.counts, -finding.nats


@dataclass(frozen=True, eq=False)
class _ChannelResult:
    data: ChannelData
    findings: tuple[Finding, ...]
    largest: float
    null: FloatArray
    systematic: float


def _test_channel(data: ChannelData, rng: np.random.Generator, draws: int) -> _ChannelResult:
    rows, fold, order = _rows_by_fold(data)
    whitener = Whitener.of(data.noise, data.time[rows], data.block[rows])
    z = _clipped(whitener(data.residual[rows, None]))
    fake = _clipped(standard_draws(data.noise.tail, (len(rows), draws), rng))
    both = np.concatenate([z, fake[order]], axis=1)
    size = max(float(np.sqrt(np.mean(data.residual[rows] ** 2))), data.noise.std)
    null = np.full(draws, -np.inf)
    found, systematic = [], 0.0
    for cells in data.cells:
        columns = cells.indicator(rows)
        sums = grams(whitener(columns), both, fold)
        gains = held_out_nats(sums, np.arange(len(sums.gram)), 1.0 / (TESTS.prior_std * size) ** 2).sum(axis=0)
        null = np.maximum(null, gains[1:])
        part = _systematic(sums, columns.mean(axis=0))
        fraction = part.size / data.noise.std
        where = _region(sums, cells)
        found.append(Finding(data.channel, cells.variables, where, float(gains[0]), fraction, fraction >= data.least))
        if len(cells.variables) == 1:
            systematic = max(systematic, part.upper(rng))
    if (tone := _tone(data)) is not None:
        found.append(tone)
        systematic = max(systematic, tone.size * data.noise.std)
    found.sort(key=_rank)
    largest = found[0].nats if found and found[0].counts else -np.inf
    return _ChannelResult(data, tuple(found[:SHOWN]), largest, null, systematic)


def _tone(data: ChannelData) -> Finding | None:
    """Return a tone that stands out beyond doubt and matters."""
    tone = strongest_tone(data.time, data.residual, data.block)
    if tone is None or tone.nats < TESTS.sure_tone or tone.rms < TESTS.equivalence * data.noise.std:
        return None
    frequency = Variable(Quantity.FREQUENCY)
    where = Span(frequency, tone.low, tone.high, "Hz")
    return Finding(data.channel, (frequency,), (where,), tone.nats, tone.rms / data.noise.std)


def _rows_by_fold(data: ChannelData) -> tuple[IntArray, IntArray, IntArray]:
    """Rows to test fold by fold, the fold of each, and which they are among them in the order of time.

    Evidence is summed over whole folds.
    """
    rows = np.flatnonzero((data.block >= 0) & np.isfinite(data.residual))
    fold = fold_of(int(data.block[rows].max()) + 1)[data.block[rows]]
    order = np.argsort(fold, kind="stable")
    return rows[order], fold[order], order


def _clipped(z: FloatArray) -> FloatArray:
    """Whitened residuals with the far tails pulled in to some robust deviations of their column."""
    limit = TESTS.clip * np.maximum(1.0, MAD_TO_STD * np.median(np.abs(z), axis=0))
    return np.clip(z, -limit, limit)


def _region(sums: Grams, cells: Cells) -> tuple[Span, ...]:
    gram = sums.gram.sum(axis=0)
    beta = solve(gram, sums.moment[:, :, 0].sum(axis=0))
    return cells.spans[int(np.argmax(beta**2 * np.diag(gram)))]


@dataclass(frozen=True, eq=False)
class _Systematic:
    """A cell-wise constant part, spread between trajectories included.

    Parameters
    ----------
    beta : (k,) array
        Estimated value in each cell.
    covariance : (k, k) array
        Of the estimate.
    fraction : (k,) array
        Of the rows in each cell; sums to 1.
    """

    beta: FloatArray
    covariance: FloatArray
    fraction: FloatArray

    @property
    def size(self) -> float:
        """Its root mean square, the estimate's scatter taken off."""
        square = float(self.fraction @ (self.beta**2 - np.diag(self.covariance)))
        return float(np.sqrt(max(0.0, square)))

    def upper(self, rng: np.random.Generator) -> float:
        """Return the upper 95 % bound of its root mean square.

        Parameters
        ----------
        rng : numpy.random.Generator
            Draws from the posterior.
        """
        k = len(self.beta)
        # Posterior draws scatter once more than the estimate did; that scatter taken off twice leaves the true part.
        root = np.linalg.cholesky(self.covariance + 1e-12 * np.trace(self.covariance) * np.eye(k))
        scattered = self.beta[:, None] + root @ rng.standard_normal((k, 400))
        squares = self.fraction @ scattered**2 - 2 * float(self.fraction @ np.diag(self.covariance))
        return float(np.sqrt(max(0.0, np.quantile(squares, 0.95))))


def _systematic(sums: Grams, fraction: FloatArray) -> _Systematic:
    gram, moment = sums.gram.sum(axis=0), sums.moment[:, :, 0].sum(axis=0)
    occupied = np.diag(gram) > 1e-9 * np.diag(gram).max()
    inverse = np.linalg.pinv(gram[np.ix_(occupied, occupied)], hermitian=True)
    fraction = fraction[occupied] / fraction[occupied].sum()
    return _Systematic(inverse @ moment[occupied], inverse, fraction)
