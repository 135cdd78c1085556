"""Residuals and signatures as the noise lets us see them: whitened, weighted, all channels on top of each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.linear import Grams, grams
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise, Whitener, estimate_noise
from gpcorrect.discrepancy.recording.stated import (
    averaged,
    rounded_to,
    samples_a_row,
    sampling_step,
    settled,
    stated_noises,
)
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Lens", "estimate_noises", "lens_on"]

FLOOR = 1e-6  # rad or m; finer residuals are rounding
MOTOR_SHARE = 1.0  # of the outside sensor's noise: an error of the motors below does not matter
MOTOR_FLOOR = 2e-4  # rad or m, where no joint is seen from outside


@dataclass(frozen=True, eq=False)
class Lens:
    """Whitens columns of condensed rows and stacks their channels.

    Parameters
    ----------
    time : (m,) array
        Seconds.
    blocks : tuple of (m,) int arrays
        For each channel, block of each row, -1 where the channel is missing or the row not looked at; from 0 without
        gaps.
    noises : tuple of ChannelNoise
        Of each channel.
    weight : (M,) array
        Of each stacked row, for heavy tails.
    """

    time: FloatArray
    blocks: tuple[IntArray, ...]
    noises: tuple[ChannelNoise, ...]
    weight: FloatArray

    @cached_property
    def block(self) -> IntArray:
        """Block `(M,)` of each stacked row."""
        return np.concatenate([b[b >= 0] for b in self.blocks])

    @cached_property
    def channel(self) -> IntArray:
        """Channel index `(M,)` of each stacked row."""
        return np.concatenate([np.full((b >= 0).sum(), i) for i, b in enumerate(self.blocks)])

    def look(self, values: FloatArray) -> FloatArray:
        """Whitened and weighted columns `(M, k)` of values `(m, c, k)`."""
        seen, begin = np.zeros((len(self.weight), values.shape[2])), 0
        for i, (rows, whitener) in enumerate(self._whiteners):
            column, part = values[rows, i], slice(begin, begin + len(rows))
            moving = np.flatnonzero(column.any(axis=0))  # most effects show in few channels
            seen[part, moving] = whitener(column[:, moving])
            begin += len(rows)
        seen *= self.weight[:, None]
        return seen

    @cached_property
    def _whiteners(self) -> list[tuple[IntArray, Whitener]]:
        """Rows of each channel that are looked at, and their filter."""
        rows = [np.flatnonzero(block >= 0) for block in self.blocks]
        filters = [
            Whitener.of(noise, self.time[r], block[r])
            for r, block, noise in zip(rows, self.blocks, self.noises, strict=True)
        ]
        return list(zip(rows, filters, strict=True))

    def look_one(self, values: FloatArray) -> FloatArray:
        """Whitened and weighted column `(M,)` of values `(m, c)`."""
        return self.look(values[:, :, None])[:, 0]

    def grams(self, columns: FloatArray, residual: FloatArray) -> Grams:
        """Products of seen columns `(M, k)` and seen residual `(M,)` for each block."""
        return grams(columns, residual, self.block)


def estimate_noises(bench: Bench, residual: FloatArray, rows: BoolArray) -> tuple[ChannelNoise, ...]:
    """Noise of every channel: as the model states it, else estimated on these rows of a residual `(m, c)`."""
    block = np.where(rows, bench.block, -1)
    own = [estimate_noise(bench.time, column, block, bench.still, FLOOR) for column in residual.T]
    own = [rounded_to(n, resolution) for n, resolution in zip(own, bench.resolution, strict=True)]
    count, step = samples_a_row(bench.group), sampling_step(bench.scene)
    stated = [n and averaged(n, count, step) for n in stated_noises(bench.scene)]
    own = [settled(o, s, count * step) for o, s in zip(own, stated, strict=True)]
    channels = bench.scene.channels
    outside = {c.joint: n.std for c, n in zip(channels, own, strict=True) if c.signal == "external_jp"}
    floors = [0.0 if c.signal != "measured_jp" else MOTOR_SHARE * outside.get(c.joint, MOTOR_FLOOR) for c in channels]
    # Encoders have hardly any noise: a servo model that is wrong by less than the outside sensors see is not missing.
    return tuple(replace(n, white=max(n.white, floor)) for n, floor in zip(own, floors, strict=True))


def lens_on(bench: Bench, residual: FloatArray, rows: BoolArray, noises: tuple[ChannelNoise, ...]) -> Lens:
    """Look at some condensed rows `(m,)` through these noises.

    With weights that calm the tails of this residual `(m, c)`.
    """
    blocks = []
    wanted = np.unique(bench.block[rows])
    dense = np.full(int(bench.block.max()) + 1, -1)
    dense[wanted] = np.arange(len(wanted))
    for column in residual.T:
        blocks.append(np.where(rows & np.isfinite(column), dense[bench.block], -1))
    n = sum(int((b >= 0).sum()) for b in blocks)
    plain = Lens(bench.time, tuple(blocks), noises, np.ones(n))
    z = plain.look_one(residual)
    weight = np.ones(n)
    for i, noise in enumerate(noises):
        mine = plain.channel == i
        if np.isfinite(noise.tail) and mine.any():
            weight[mine] = _weights(z[mine], noise.tail)
    return replace(plain, weight=weight)


def _weights(z: FloatArray, tail: float) -> FloatArray:
    """Roots of the weights of maximum likelihood under Student's t, of unit mean square."""
    core = NORMAL_MAD / student.ppf(0.75, tail)
    spread = max(1.0, float(np.median(np.abs(z))) / NORMAL_MAD)
    weight = (tail + 1.0) / (tail + (z / (core * spread)) ** 2)
    root: FloatArray = np.sqrt(np.minimum(weight, 1.0))
    return root
