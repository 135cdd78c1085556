"""Figures on the test set: what the named effects close, beside a permutation control and a black box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.evidence.variables import travel_direction
from gpcorrect.discrepancy.outcome.result import ChannelGap, Evidence, GapFigures
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.gpr import ExactGPR
from gpcorrect.types import BoolArray, FloatArray, IntArray

DRAWS = 1000  # of the bootstrap: its 2.5 % ends then rest on 25 draws each
BLACK_BOX_ROWS = 250  # of the exact process, for time: its cost grows with their cube
RIDGE = 1e-6  # of the signatures' energy: only keeps alike signatures solvable


def _rms(values: FloatArray) -> float:
    """Root mean square of the finite values; NaN when there is none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")


def closed_gap(before: float | FloatArray, after: float | FloatArray, noise: float) -> FloatArray:
    """Return the fraction of the mean square beyond noise that is gone; NaN where there was none.

    Parameters
    ----------
    before, after : float or array
        Root mean squares.
    noise : float
        Standard deviation.
    """
    gap = np.asarray(before, dtype=np.float64) ** 2 - noise**2
    left = np.asarray(after, dtype=np.float64) ** 2 - noise**2
    fraction: FloatArray = np.where(gap > 0, 1.0 - left / np.where(gap > 0, gap, 1.0), np.nan)
    return fraction


def gap_figures(
    before: FloatArray, after: FloatArray, noise: float, block: IntArray, rng: np.random.Generator
) -> GapFigures:
    """Return the figures of one channel.

    Parameters
    ----------
    before, after : (n,) arrays
        Residuals of the test set; NaN is missing.
    noise : float
        Standard deviation of the channel's noise.
    block : (n,) int array
        Trajectory of each row: the bootstrap draws whole ones.
    rng : numpy.random.Generator
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
        before=_rms(before),
        after=_rms(after),
        noise=noise,
        p95=(float(np.percentile(sizes[0], 95)), float(np.percentile(sizes[1], 95))),
        largest=(float(sizes[0].max()), float(sizes[1].max())),
        closed=float(closed_gap(_rms(before), _rms(after), noise)),
        closed_ci95=(float(low), float(high)),
    )


def black_box(inputs: FloatArray, residual: FloatArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Return a residual `(n,)` once a Gaussian process on its inputs is taken off.

    Parameters
    ----------
    inputs : (n, d) array
        Variables of the motor side.
    residual : (n,) array
        NaN is missing.
    train : (n,) bool array
        Rows to fit to.
    rng : numpy.random.Generator
        Chooses among them.

    Notes
    -----
    The package's own exact process: squared-exponential kernel with one length scale an input, on at most 250 rows.
    """
    rows = np.flatnonzero(train & np.isfinite(residual))
    if len(rows) > BLACK_BOX_ROWS:
        rows = np.sort(rng.choice(rows, BLACK_BOX_ROWS, replace=False))
    model = ExactGPR(n_learn=BLACK_BOX_ROWS).fit(inputs[rows], residual[rows])
    left: FloatArray = residual - model.predict(inputs)
    return left


def permutation_control(
    signatures: FloatArray, residual: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator
) -> FloatArray:
    """Return a residual `(n,)` once the effects' signatures, fitted to exchanged trajectories, are taken off.

    Least squares of the signatures' sizes on a residual whose whole trajectories are dealt to the motion of others:
    nothing true can be learned, so what it closes is what any fit of this freedom closes.

    Parameters
    ----------
    signatures : (n, k) array
        Change of the channel by each effect.
    residual : (n,) array
        NaN is missing.
    block : (n,) int array
        Trajectory of each row.
    train : (n,) bool array
        Rows to fit to.
    rng : numpy.random.Generator
    """
    shuffled = exchanged(residual, block, train, rng)
    rows = train & np.isfinite(shuffled)
    x = signatures[rows]
    energy = np.diag(x.T @ x) + 1e-300
    sizes = np.linalg.solve(x.T @ x + RIDGE * np.diag(energy), x.T @ shuffled[rows])
    left: FloatArray = residual - signatures @ sizes
    return left


def exchanged(values: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Return values `(n,)` with every training trajectory's content taken from another one, signs drawn.

    The trajectories stand in a random ring, each takes the content of the one before it: none keeps its own, where
    there are two or more. A shorter content is repeated. Rows outside are NaN.

    Parameters
    ----------
    values : (n,) array
        To exchange.
    block : (n,) int array
        Trajectory of each row.
    train : (n,) bool array
        Rows whose trajectories take part.
    rng : numpy.random.Generator
    """
    ring = rng.permutation(np.unique(block[train]))
    result = np.full(len(values), np.nan)
    for here, there in zip(ring, np.roll(ring, 1), strict=True):
        rows = np.flatnonzero(block == here)
        result[rows] = rng.choice([-1.0, 1.0]) * np.resize(values[block == there], len(rows))
    return result


def gaps_of(
    prepared: PreparedData, fitted: Sequence[FittedEffect], noises: Sequence[ChannelNoise], rng: np.random.Generator
) -> tuple[ChannelGap, ...]:
    """Return the figures of every channel on the test set.

    Parameters
    ----------
    prepared : PreparedData
        The recording.
    fitted : sequence of FittedEffect
        Named effects.
    noises : sequence of ChannelNoise
    rng : numpy.random.Generator
        For bootstrap and controls.
    """
    dataset = prepared.dataset.strict()
    before, after = dataset.residual(), dataset.residual([f.effect for f in fitted])
    changes = _changes(prepared, fitted)
    test, train = dataset.test, dataset.training
    gaps = []
    for i, channel in enumerate(dataset.scene.channels):
        noise = noises[i].std
        figures = gap_figures(before[test, i], after[test, i], noise, dataset.block[test], rng)
        inputs = np.stack(list(prepared.inputs[i].values.values()), axis=1)
        boxed = black_box(inputs, before[:, i], train, rng)
        columns = [c[:, i] for c in changes if c[:, i].any()]
        control = float("nan")
        if columns:
            left = permutation_control(np.stack(columns, axis=1), before[:, i], dataset.block, train, rng)
            control = float(closed_gap(figures.before, _rms(left[test]), noise))
        ceiling = float(closed_gap(figures.before, _rms(boxed[test]), noise))
        gap = ChannelGap(**vars(figures), channel=channel, black_box_ceiling=ceiling, permutation_control=control)
        gaps.append(gap)
    return tuple(gaps)


def _changes(prepared: PreparedData, fitted: Sequence[FittedEffect]) -> list[FloatArray]:
    """Change of the channels `(m, c)` by each effect alone."""
    dataset = prepared.dataset.strict()
    nominal = dataset.predict()
    return [dataset.predict([f.effect]) - nominal for f in fitted]


def evidence_of(prepared: PreparedData, state: Search, fitted: Sequence[FittedEffect]) -> Evidence:
    """Return residuals, motor paths and likeness of the signatures, of the condensed rows.

    Parameters
    ----------
    prepared : PreparedData
        The recording.
    state : Search
        After the naming.
    fitted : sequence of FittedEffect
        Named effects.
    """
    dataset, scene = prepared.dataset.strict(), prepared.dataset.scene
    motor, run = scene.motor_path(), scene.run_of_row()
    direction = np.stack([travel_direction(c, run) for c in motor.T], axis=1)
    correlation = np.zeros((0, 0))
    if fitted:
        white = state.whitener.whiten_columns(np.stack(_changes(prepared, fitted), axis=2))
        size = np.linalg.norm(white, axis=0)
        correlation = white.T @ white / np.maximum(np.outer(size, size), 1e-300)
    return Evidence(
        before=dataset.residual(),
        after=dataset.residual([f.effect for f in fitted]),
        motor=dataset.means(motor),
        direction=dataset.means(direction),
        joint=tuple(c.index if c.joint else -1 for c in scene.channels),
        test=dataset.test,
        correlation=correlation,
        labels=tuple(f.candidate.label for f in fitted),
        waterfall=state.waterfall,
    )
