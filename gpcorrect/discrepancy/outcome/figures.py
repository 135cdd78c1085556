"""Figures on the test set: what the named effects close, beside a permutation control and a black box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.evidence.variables import travel_direction
from gpcorrect.discrepancy.evidence.whitener import whitener_on
from gpcorrect.discrepancy.outcome.result import ChannelGap, Evidence
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.gpr import ExactGPR
from gpcorrect.types import BoolArray, FloatArray, IntArray

DRAWS = 1000  # of the bootstrap: its 2.5 % ends then rest on 25 draws each
BLACK_BOX_ROWS = 250  # of the exact process, for time: its cost grows with their cube


def gaps_of(
    prepared: PreparedData, fitted: Sequence[FittedEffect], noises: Sequence[ChannelNoise], rng: np.random.Generator
) -> tuple[ChannelGap, ...]:
    """Return the figures of every channel on the test set.

    Parameters
    ----------
    prepared : PreparedData
    fitted : sequence of FittedEffect, named effects
    noises : sequence of ChannelNoise
    rng : numpy.random.Generator, for bootstrap and controls
    """
    dataset = prepared.dataset.strict()
    effects, test, train = [f.effect for f in fitted], dataset.test, dataset.training
    before, after, signatures = dataset.residual(), dataset.residual(effects), dataset.changes(effects)
    whitener = whitener_on(dataset, after, test, tuple(noises))
    white, gaps = whitener.whiten(after), []
    for i, channel in enumerate(dataset.scene.channels):
        own_white = white[whitener.channel == i]
        noise, inputs = noises[i].std, np.stack(list(prepared.inputs[i].values.values()), axis=1)
        seen = test & np.isfinite(before[:, i]) & np.isfinite(after[:, i])
        own = np.stack([before[seen, i], after[seen, i]])
        interval = _closed_ci95(own, noise, dataset.block[seen], rng)
        sizes = np.abs(own) if seen.any() else np.full((2, 1), np.nan)
        rms = np.sqrt(np.mean(sizes**2, axis=1))
        known = bool((train & np.isfinite(before[:, i])).any())
        boxed = black_box(inputs, before[:, i], train, rng) if known else before[:, i]
        columns = signatures[:, i, signatures[:, i].any(axis=0)]
        control = np.nan
        if known and columns.shape[1]:
            left = _permutation_control(columns, before[:, i], dataset.block, train, rng)
            control = float(_closed(rms[0], _rms(left[test]), noise))
        gaps.append(
            ChannelGap(
                channel=channel,
                before=float(rms[0]),
                after=float(rms[1]),
                noise=noise,
                p95=(float(np.percentile(sizes[0], 95)), float(np.percentile(sizes[1], 95))),
                largest=(float(sizes[0].max()), float(sizes[1].max())),
                closed=float(_closed(rms[0], rms[1], noise)),
                closed_ci95=interval,
                black_box_ceiling=float(_closed(rms[0], _rms(boxed[test]), noise)),
                permutation_control=control,
                chance=float(chi2.sf(own_white @ own_white, max(len(own_white), 1))),
            )
        )
    return tuple(gaps)


def _rms(values: FloatArray) -> float:
    """Root mean square of the finite values; NaN when there is none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else np.nan


def _closed(before: float | FloatArray, after: float | FloatArray, noise: float) -> FloatArray:
    """Return the fraction of the mean square beyond noise that is gone; NaN where there was none."""
    gap, left = np.square(before) - noise**2, np.square(after) - noise**2
    return np.asarray(np.where(gap > 0, 1.0 - left / np.where(gap > 0, gap, 1.0), np.nan))


def _closed_ci95(residuals: FloatArray, noise: float, block: IntArray, rng: np.random.Generator) -> tuple[float, float]:
    """Bootstrap interval of what is closed from the first row of residuals `(2, n)` to the second, by whole blocks."""
    if not len(block):
        return float("nan"), float("nan")
    _, index, count = np.unique(block, return_inverse=True, return_counts=True)
    draw = rng.integers(len(count), size=(DRAWS, len(count)))
    total = count[draw].sum(axis=1)
    before, after = (np.sqrt(np.bincount(index, r**2)[draw].sum(axis=1) / total) for r in residuals)
    drawn = _closed(before, after, noise)
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.quantile(drawn, [0.025, 0.975]) if len(drawn) else (np.nan, np.nan)
    return float(low), float(high)


def black_box(inputs: FloatArray, residual: FloatArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Return a residual `(n,)` once a Gaussian process on its inputs is taken off.

    The package's own exact process: squared-exponential kernel with one length scale an input, on at most 250 rows.

    Parameters
    ----------
    inputs : (n, d) array, variables of the motor side
    residual : (n,) array, NaN is missing
    train : (n,) bool array, rows to fit to
    rng : numpy.random.Generator, chooses among them
    """
    rows = np.flatnonzero(train & np.isfinite(residual))
    if len(rows) > BLACK_BOX_ROWS:
        rows = np.sort(rng.choice(rows, BLACK_BOX_ROWS, replace=False))
    model = ExactGPR(n_learn=BLACK_BOX_ROWS).fit(inputs[rows], residual[rows])
    return np.asarray(residual - model.predict(inputs))


def _permutation_control(
    signatures: FloatArray, residual: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator
) -> FloatArray:
    """Return a residual `(n,)` once the effects' signatures, fitted to exchanged trajectories, are taken off.

    Least squares of the signatures' sizes on a residual whose whole trajectories are dealt to the motion of others:
    nothing true can be learned, so what it closes is what any fit of this freedom closes.
    """
    shuffled = exchanged(residual, block, train, rng)
    rows = train & np.isfinite(shuffled)
    x = signatures[rows]
    return np.asarray(residual - signatures @ solve(x.T @ x, x.T @ shuffled[rows]))


def exchanged(values: FloatArray, block: IntArray, train: BoolArray, rng: np.random.Generator) -> FloatArray:
    """Return values `(n,)` with every training trajectory's content taken from another one, signs drawn.

    The trajectories stand in a random ring, each takes the content of the one before it: none keeps its own, where
    there are two or more. A shorter content is repeated. Rows outside are NaN.

    Parameters
    ----------
    values : (n,) array, to exchange
    block : (n,) int array, trajectory of each row
    train : (n,) bool array, rows whose trajectories take part
    rng : numpy.random.Generator
    """
    ring = rng.permutation(np.unique(block[train]))
    result = np.full(len(values), np.nan)
    for here, there in zip(ring, np.roll(ring, 1), strict=True):
        rows = np.flatnonzero(block == here)
        result[rows] = rng.choice([-1.0, 1.0]) * np.resize(values[block == there], len(rows))
    return result


def evidence_of(state: Search, fitted: Sequence[FittedEffect]) -> Evidence:
    """Return residuals, motor paths and likeness of the signatures, of the condensed rows.

    Parameters
    ----------
    state : Search, after the naming
    fitted : sequence of FittedEffect, named effects
    """
    dataset, scene, effects = state.dataset.strict(), state.dataset.scene, [f.effect for f in fitted]
    motor, run = scene.motor_path(), scene.run_of_row()
    direction = np.stack([travel_direction(c, run) for c in motor.T], axis=1)
    white = state.whitener.whiten_columns(dataset.changes(effects))
    size = np.linalg.norm(white, axis=0)
    return Evidence(
        before=dataset.residual(),
        after=dataset.residual(effects),
        motor=dataset.means(motor),
        direction=dataset.means(direction),
        joint=tuple(c.index if c.joint else -1 for c in scene.channels),
        test=dataset.test,
        correlation=white.T @ white / np.maximum(np.outer(size, size), 1e-300),
        labels=tuple(f.candidate.label for f in fitted),
        waterfall=state.waterfall,
    )
