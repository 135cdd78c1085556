"""Where simulation and measurement disagree: the small tests that beat the largest of them in noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lombscargle
from scipy.special import digamma, polygamma
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.linear import fold_of, grams, held_out_nats, solve
from gpcorrect.discrepancy.evidence.variables import Cells, Quantity, Span, Variable
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise, Whitener
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import FloatArray, IntArray

SHOWN = 5  # findings of a channel
# Of the spectra that tones are sought in; the fewest were chosen by hand on development cases.
FEWEST_ROWS, MOST_ROWS = 40, 400  # of a piece
FEWEST_PIECES, FEWEST_FREQUENCIES = 4, 40  # to average a spectrum over, and to fit a smooth one through
CYCLES = 3.0  # in a piece, at least
FINER = 2  # frequencies for each that can be resolved
DEGREE, ROUNDS = 5, 20  # of the curve through a spectrum, and of fitting it
CLIP = 5.0  # robust standard deviations


@dataclass(frozen=True, eq=False)
class ChannelData:
    """One channel as the tests see it."""

    channel: Channel
    time: FloatArray  # (n,) s
    residual: FloatArray  # (n,) NaN is missing
    block: IntArray  # (n,) whole trajectories from 0 without gaps, -1 for rows to leave out
    noise: ChannelNoise
    cells: Sequence[Cells]  # the tests


@dataclass(frozen=True)
class Finding:
    """A test that noise cannot explain: where along what it depends on the residual is largest."""

    channel: Channel
    region: tuple[Span, ...]
    nats: float  # gained on held-out trajectories
    size: float  # root mean square of what depends on the variables, as a fraction of the noise
    counts: bool = True  # whether that is large enough to matter


@dataclass(frozen=True)
class Equivalence:
    """How large a channel's systematic part may be, as a fraction of its noise."""

    channel: Channel
    upper: float  # 95 % bound

    @property
    def shown(self) -> bool:
        """Whether the systematic part is shown to be too small to matter."""
        return self.upper < TESTS.equivalence


@dataclass(frozen=True)
class Localisation:
    """Outcome of all tests."""

    findings: tuple[Finding, ...]  # above the threshold, largest first, those too small to count as well
    threshold: float  # nats that the largest of all tests stays below in noise, with the level's probability
    equivalence: tuple[Equivalence, ...]

    @property
    def something(self) -> bool:
        """Whether anything beats noise that is large enough to count."""
        return any(f.counts for f in self.findings)

    @property
    def worth_a_search(self) -> bool:
        """Whether anything beats noise, be it too small to count: a name may still be sure."""
        return bool(self.findings)

    @property
    def nothing(self) -> bool:
        """Whether nothing beats noise and every channel's systematic part is shown to be too small to matter."""
        return not self.something and all(e.shown for e in self.equivalence)


def localise(channels: Sequence[ChannelData], rng: np.random.Generator) -> Localisation:
    """Run every test of every channel, and the null law of the largest of them by parametric bootstrap from the noise.

    Parameters
    ----------
    channels : sequence of ChannelData
    rng : numpy.random.Generator, draws the bootstrap
    """
    findings: list[Finding] = []
    bounds: list[Equivalence] = []
    null = np.full(TESTS.draws, -np.inf)
    for data in channels:
        if not (data.block >= 0).any():  # no sample: nothing is known of it
            bounds.append(Equivalence(data.channel, np.inf))
            continue
        found, null_nats, upper = _test_channel(data, rng)
        findings += found[:SHOWN]
        null = np.maximum(null, null_nats)
        bounds.append(Equivalence(data.channel, upper))
    threshold = max(0.0, _quantile_of_largest(null)) if np.isfinite(null).all() else 0.0
    above = sorted((f for f in findings if f.nats > threshold), key=_rank)
    return Localisation(tuple(above), threshold, tuple(bounds))


def _quantile_of_largest(null: FloatArray) -> float:
    """Return the level's quantile of a maximum of many: of the Gumbel law with the draws' mean and standard deviation.

    Its 99 % quantile from 60 draws is as sure (half a standard deviation) as the third largest of 300 (Gumbel 1958,
    Statistics of Extremes, Sec. 6.2).
    """
    scale = float(np.std(null)) * np.sqrt(6.0) / np.pi
    return float(np.mean(null) - scale * (np.euler_gamma + np.log(-np.log(TESTS.level))))


def _rank(finding: Finding) -> tuple[bool, float]:
    return not finding.counts, -finding.nats


def _test_channel(data: ChannelData, rng: np.random.Generator) -> tuple[list[Finding], FloatArray, float]:
    """Return all findings, the best first, the largest nats in each draw of noise, and how large the rest may be."""
    rows = np.flatnonzero((data.block >= 0) & np.isfinite(data.residual))
    fold = fold_of(int(data.block[rows].max()) + 1)[data.block[rows]]  # evidence is summed over whole folds
    whitener = Whitener.of(data.noise, data.time[rows], data.block[rows])
    z = _clipped(whitener(data.residual[rows, None]))
    both = np.concatenate([z, _clipped(_noise(data.noise.tail, (len(rows), TESTS.draws), rng))], axis=1)
    std = data.noise.std
    precision = 1.0 / (TESTS.prior_std * max(float(np.sqrt(np.mean(data.residual[rows] ** 2))), std)) ** 2
    null = np.full(TESTS.draws, -np.inf)
    # A servo model that is wrong by far less than the outside sensors see is not missing, however often it is seen.
    least = TESTS.equivalence if data.channel.signal == "measured_jp" else 0.0
    found, systematic = [], 0.0
    for cells in data.cells:
        columns = np.eye(len(cells.spans))[cells.code[rows]]  # one for each cell, 1 where a row is in it
        sums = grams(whitener(columns), both, fold)
        gains = held_out_nats(sums, np.arange(len(sums.gram)), precision).sum(axis=0)
        null = np.maximum(null, gains[1:])
        gram, moment = sums.gram.sum(axis=0), sums.moment[:, :, 0].sum(axis=0)
        alone = len(cells.variables) == 1
        size, upper = _systematic(gram, moment, columns.mean(axis=0), rng if alone else None)
        systematic = max(systematic, upper)
        region = cells.spans[int(np.argmax(solve(gram, moment) ** 2 * np.diag(gram)))]
        counts = size / std >= least
        found.append(Finding(data.channel, region, float(gains[0]), size / std, counts))
    tone = strongest_tone(data.time, data.residual, data.block)
    if tone is not None and tone.nats >= TESTS.sure_tone and tone.rms >= TESTS.equivalence * std:
        region = (Span(Variable(Quantity.FREQUENCY, unit="Hz"), tone.low, tone.high),)
        found.append(Finding(data.channel, region, tone.nats, tone.rms / std))
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


@dataclass(frozen=True)
class Tone:
    """A narrow peak of a spectrum that no variable of the motion explains: a pump, mains, a floor that shakes."""

    low: float  # Hz
    high: float
    rms: float  # of what is above the spectrum around it
    nats: float  # minus the logarithm of a bound on the chance of such a peak anywhere in noise of a smooth spectrum


def strongest_tone(time: FloatArray, residual: FloatArray, block: IntArray) -> Tone | None:
    """Return the most unlikely peak; None when the recording is too short to say.

    Cells of variables cannot see a tone, for its phase is another one in every trajectory. Periodograms are averaged
    over trajectories, where noise gives a smooth spectrum and a tone a narrow peak (Percival and Walden 1993, Ch. 10).

    Parameters
    ----------
    time, residual : (n,) arrays, seconds, and residual; NaN is missing
    block : (n,) int array, trajectory of each row; -1 for rows to leave out
    """
    seen = np.where(np.isfinite(residual), block, -1)
    rows = [np.flatnonzero(seen == k) for k in np.unique(seen[seen >= 0])]
    parts = [p for own in rows for p in np.array_split(own, int(np.ceil(len(own) / MOST_ROWS)))]
    pieces = [p for p in parts if len(p) >= FEWEST_ROWS]
    if len(pieces) < FEWEST_PIECES:
        return None
    span = float(np.median([np.ptp(time[p]) for p in pieces]))
    step = float(np.median(np.concatenate([np.diff(time[p]) for p in pieces])))
    frequency = np.arange(CYCLES / span, 0.5 / step, 1.0 / (FINER * span))
    if len(frequency) < FEWEST_FREQUENCIES:
        return None
    scale = float(np.median(np.abs(residual[np.concatenate(pieces)]))) / NORMAL_MAD
    power = np.mean([_power(time[p], residual[p], scale, frequency) for p in pieces], axis=0)
    background = _smooth(power, frequency, len(pieces))
    ratio = np.maximum(power / background, 1.0)
    peak = int(np.argmax(ratio))
    # Chernoff's bound on the chance that the mean of so many exponential variables is as large, at any frequency.
    nats = len(pieces) * float(ratio[peak] - 1.0 - np.log(ratio[peak])) - float(np.log(len(frequency)))
    rms = float(np.sqrt(max(0.0, power[peak] - background[peak])))
    width = 1.0 / span  # of what can be resolved
    return Tone(float(frequency[peak]) - width, float(frequency[peak]) + width, rms, nats)


def _power(time: FloatArray, values: FloatArray, scale: float, frequency: FloatArray) -> FloatArray:
    """Mean square of a sine fitted at each frequency, outliers clipped."""
    values = np.clip(values - values.mean(), -CLIP * scale, CLIP * scale)
    power: FloatArray = np.asarray(lombscargle(time, values, 2.0 * np.pi * frequency)) * (2.0 / len(time))
    return power


def _smooth(power: FloatArray, frequency: FloatArray, pieces: int) -> FloatArray:
    """Spectrum of the noise: a smooth curve of logarithms that peaks hardly move."""
    x = np.log(frequency)
    columns = np.vander((x - x.mean()) / np.ptp(x), DEGREE + 1)
    height = np.log(np.maximum(power, 1e-300)) - (digamma(pieces) - np.log(pieces))  # mean of log Gamma
    spread = np.sqrt(polygamma(1, pieces))
    weight = np.ones(len(x))
    for _ in range(ROUNDS):
        beta = np.linalg.lstsq(columns * weight[:, None], height * weight, rcond=None)[0]
        weight = 1.0 / np.sqrt(1.0 + ((height - columns @ beta) / (2.0 * spread)) ** 2)
    smooth: FloatArray = np.exp(columns @ beta)
    return smooth
