"""A dataset whitened by its noise: residuals and signatures whitened, weighted, all channels on top of each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise, Whitener, estimate_noise
from gpcorrect.discrepancy.recording.stated_noise import averaged, chosen_noise, rounded_to, stated_noises
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class DatasetWhitener:
    """Whitens columns of the m condensed rows of a dataset and stacks their channels to M rows."""

    dataset: Dataset
    blocks: tuple[IntArray, ...]  # (m,) of each channel, from 0 without gaps, -1 where it is missing or left out
    noises: tuple[ChannelNoise, ...]
    weight: FloatArray  # (M,) reduces heavy tails

    @cached_property
    def block(self) -> IntArray:
        """Block `(M,)` of each stacked row."""
        return np.concatenate([b[b >= 0] for b in self.blocks])

    @cached_property
    def channel(self) -> IntArray:
        """Channel index `(M,)` of each stacked row."""
        return np.concatenate([np.full((b >= 0).sum(), i) for i, b in enumerate(self.blocks)])

    def of_channels(self, wanted: BoolArray) -> DatasetWhitener:
        """Return the whitener of some channels alone.

        Parameters
        ----------
        wanted : (c,) bool array
        """
        if wanted.all():
            return self
        blocks = tuple(b if seen else np.full_like(b, -1) for b, seen in zip(self.blocks, wanted, strict=True))
        return replace(self, blocks=blocks, weight=self.weight[wanted[self.channel]])

    @property
    def std(self) -> FloatArray:
        """(c,) standard deviation of the noise."""
        return np.array([n.std for n in self.noises])

    @cached_property
    def _filters(self) -> list[tuple[IntArray, Whitener]]:
        """Rows of each channel that are used, and their filter."""
        rows = [np.flatnonzero(block >= 0) for block in self.blocks]
        parts = zip(rows, self.blocks, self.noises, strict=True)
        return [(r, Whitener.of(noise, self.dataset.time[r], block[r])) for r, block, noise in parts]

    def whiten_columns(self, values: FloatArray, channels: BoolArray | None = None) -> FloatArray:
        """Return k columns of some channels, by default of all, whitened and weighted, on top of each other `(N, k)`.

        Parameters
        ----------
        values : (m, s, k) array, of the s channels that are asked for
        channels : (c,) bool array, which ones those are
        """
        asked = np.arange(len(self.blocks)) if channels is None else np.flatnonzero(channels)
        white = [np.zeros((0, values.shape[2]))]
        for i, channel in enumerate(asked):
            rows, whitener = self._filters[channel]
            white.append(whitener(values[rows, i], self.weight[self.channel == channel]))
        return np.concatenate(white)

    def whiten(self, values: FloatArray) -> FloatArray:
        """Return one column of every channel whitened and weighted `(M,)`.

        Parameters
        ----------
        values : (m, c) array
        """
        return self.whiten_columns(values[:, :, None])[:, 0]


def estimate_noises(dataset: Dataset, residual: FloatArray, rows: BoolArray) -> tuple[ChannelNoise, ...]:
    """Return the noise of every channel: as the model states it, else as the residual shows it.

    Parameters
    ----------
    dataset : Dataset
    residual : (m, c) array, measured minus simulated
    rows : (m,) bool array, those to estimate on
    """
    scene, channels = dataset.scene, dataset.scene.channels
    block = np.where(rows, dataset.block, -1)
    count, step = dataset.samples_a_row, scene.step
    noises = []
    known = stated_noises(scene, dataset.resolution)
    for column, resolution, stated in zip(residual.T, dataset.resolution, known, strict=True):
        own = estimate_noise(dataset.time, column, block, dataset.still, NOISE.floor)
        if own.std < resolution:  # steps hide in holds what they do not while the joint moves
            moving, nowhere = np.where(dataset.still, -1, block), np.zeros_like(dataset.still)
            seen = estimate_noise(dataset.time, column, moving, nowhere, NOISE.floor)
            own = rounded_to(own, resolution, seen)
        noises.append(chosen_noise(own, stated and averaged(stated, count, step), count * step))
    outside = {c.joint: n.std for c, n in zip(channels, noises, strict=True) if c.signal == "external_jp"}
    position = max((n.std for c, n in zip(channels, noises, strict=True) if c.signal == "tracker_cp"), default=0.0)
    felt = {
        joint: position / lever if position and lever else NOISE.motor_floor
        for joint, lever in zip(scene.joints, dataset.levers, strict=True)
    }
    # Encoders have hardly any noise: a servo model that is wrong by less than the outside sensors see is not missing.
    floors = [
        NOISE.motor_fraction * outside.get(c.joint, felt[c.joint])
        if c.signal == "measured_jp"
        else position / NOISE.marker_size * (c.signal == "tracker_rotation")
        for c in channels
    ]
    return tuple(replace(n, white=max(n.white, floor)) for n, floor in zip(noises, floors, strict=True))


def whitener_on(
    dataset: Dataset, residual: FloatArray, rows: BoolArray, noises: tuple[ChannelNoise, ...] | None = None
) -> DatasetWhitener:
    """Return the whitener of some condensed rows, with weights that reduce the tails of a residual.

    Parameters
    ----------
    dataset : Dataset
    residual : (m, c) array, whose tails are reduced
    rows : (m,) bool array, those to use
    noises : tuple of ChannelNoise, optional, estimated on these rows when None
    """
    noises = noises or estimate_noises(dataset, residual, rows)
    wanted = np.unique(dataset.block[rows])
    dense = np.full(int(dataset.block.max()) + 1, -1)
    dense[wanted] = np.arange(len(wanted))
    blocks = tuple(np.where(rows & np.isfinite(column), dense[dataset.block], -1) for column in residual.T)
    n_rows = sum(int((b >= 0).sum()) for b in blocks)
    plain = DatasetWhitener(dataset, blocks, noises, np.ones(n_rows))
    z, weight = plain.whiten(residual), np.ones(n_rows)
    for i, noise in enumerate(noises):
        own = plain.channel == i
        if np.isfinite(noise.tail) and own.any():
            weight[own] = _weights(z[own], noise.tail)
    return replace(plain, weight=weight)


def _weights(z: FloatArray, tail: float) -> FloatArray:
    """Roots of the weights of maximum likelihood under Student's t, of unit mean square."""
    core = NORMAL_MAD / student.ppf(0.75, tail)
    spread = max(1.0, float(np.median(np.abs(z))) / NORMAL_MAD)
    weight = (tail + 1.0) / (tail + (z / (core * spread)) ** 2)
    root: FloatArray = np.sqrt(np.minimum(weight, 1.0))
    return root
