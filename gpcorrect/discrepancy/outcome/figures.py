"""What is reported of a finished run: figures on the sealed part, and the rows that pictures are drawn from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.outcome.controls import black_box, placebo
from gpcorrect.discrepancy.outcome.gap import closed_gap, gap_figures, rms
from gpcorrect.discrepancy.outcome.result import ChannelGap, Evidence
from gpcorrect.discrepancy.recording.covariates import travel_direction
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.laid import Laid
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.types import FloatArray

__all__ = ["evidence_of", "gaps_of"]


def gaps_of(
    data: Laid, members: Sequence[Member], noises: Sequence[ChannelNoise], rng: np.random.Generator
) -> tuple[ChannelGap, ...]:
    """Figures of every channel on the sealed part."""
    bench = data.bench.strict()
    before, after = bench.residual(), bench.residual([m.effect for m in members])
    nominal = bench.predict()
    changes = [bench.predict([m.effect]) - nominal for m in members]
    sealed = bench.sealed
    gaps = []
    for i, channel in enumerate(bench.scene.channels):
        noise = noises[i].std
        figures = gap_figures(before[sealed, i], after[sealed, i], noise, bench.block[sealed], rng)
        inputs = np.stack(list(data.inputs[i].values.values()), axis=1)
        boxed = black_box(inputs, before[:, i], bench.seen, rng)
        columns = [c[:, i] for c in changes if c[:, i].any()]
        fooled = float("nan")
        if columns:
            left = placebo(np.stack(columns, axis=1), before[:, i], bench.block, bench.seen, rng)
            fooled = float(closed_gap(figures.before, rms(left[sealed]), noise))
        ceiling = float(closed_gap(figures.before, rms(boxed[sealed]), noise))
        gaps.append(ChannelGap(channel.name, channel.unit, figures, ceiling, fooled))
    return tuple(gaps)


def evidence_of(data: Laid, state: Search, members: Sequence[Member]) -> Evidence:
    """Residuals, motor paths and signature likeness of the condensed rows."""
    bench, scene = data.bench.strict(), data.bench.scene
    motor = scene.motor_path()
    run = scene.run_of_row()
    direction = np.stack([travel_direction(c, run) for c in motor.T], axis=1)
    nominal = bench.predict()
    labels = [m.candidate.label for m in members]
    changes = [bench.predict([m.effect]) - nominal for m in members]
    return Evidence(
        before=bench.residual(),
        after=bench.residual([m.effect for m in members]),
        motor=bench.means(motor),
        direction=bench.means(direction),
        joint=tuple(c.index if c.joint else -1 for c in scene.channels),
        sealed=bench.sealed,
        correlation=_correlation(state, changes),
        labels=tuple(labels),
        waterfall=state.waterfall,
    )


def _correlation(state: Search, changes: Sequence[FloatArray]) -> FloatArray:
    """Cosines between whitened signatures."""
    if not changes:
        return np.zeros((0, 0))
    seen = state.lens.look(np.stack(changes, axis=2))
    size = np.linalg.norm(seen, axis=0)
    cosine: FloatArray = seen.T @ seen / np.maximum(np.outer(size, size), 1e-300)
    return cosine
