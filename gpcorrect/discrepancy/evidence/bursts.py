"""Rare moments far above the noise: too few motions see them for evidence from motion to motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.settings import BURSTS
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.sim.effects import Effect
from gpcorrect.types import FloatArray, IntArray


@dataclass(frozen=True)
class Burst:
    """A channel in which something happens far above its noise."""

    channel: Channel
    trajectories: tuple[int, ...]  # as the log numbers them
    largest: float  # residual there
    noise: float  # standard deviation
    rows: int  # condensed ones there that are above the limit
    rare: bool  # whether most trajectories are calm and without it
    # Whether moments far above the noise stand apart from calm ones, be it in every trajectory, or are the rule.
    fitful: bool = False

    @property
    def lasts(self) -> bool:
        """Whether it was long enough to be looked at in pieces: what has no name then is unknown."""
        return (self.rare or self.fitful) and self.rows >= BURSTS.lasting


def bursts_of(dataset: Dataset, noises: Sequence[ChannelNoise], effects: Sequence[Effect] = ()) -> tuple[Burst, ...]:
    """Return channels that are far above their noise in a trajectory, or now and then: such a one may not be NONE.

    The test set counts as well: nothing is fitted to it, and "nothing is missing" must hold there too.

    Parameters
    ----------
    dataset : Dataset
    noises : sequence of ChannelNoise
    effects : sequence of Effect, beyond the model's own
    """
    numbers, index = np.unique(dataset.trajectory, return_inverse=True)
    moments = np.stack([index, dataset.time // BURSTS.moment], axis=1)
    moment = np.unique(moments, axis=0, return_inverse=True)[1].ravel()
    found = []
    for channel, column, noise in zip(dataset.scene.channels, dataset.residual(effects).T, noises, strict=True):
        known, limit = np.isfinite(column), BURSTS.limit * noise.std
        rms = np.sqrt(_means(column[known] ** 2, index[known], len(numbers)))
        means = np.abs(_means(column[known], moment[known], moment.max() + 1))
        above, calm = rms > limit, np.median(rms) <= BURSTS.calm * noise.std
        usual = float(np.median(means))
        apart = means > (limit if usual > limit else max(limit, BURSTS.apart * MAD_TO_STD * usual))
        there = known & (above[index] | apart[moment])
        rows = int(np.count_nonzero(np.abs(column[there]) > limit))
        fitful = bool(apart.any()) and rows >= BURSTS.lasting
        if above.any() or fitful:
            trajectories, largest = numbers[np.unique(index[there])], float(np.abs(column[there]).max())
            rare = bool(calm) and 2 * len(trajectories) <= len(numbers)
            found.append(Burst(channel, tuple(trajectories.tolist()), largest, noise.std, rows, rare, fitful))
    return tuple(found)


def _means(values: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Mean of the values of each group; 0 where there are none."""
    return np.bincount(group, values, count) / np.maximum(np.bincount(group, minlength=count), 1)
