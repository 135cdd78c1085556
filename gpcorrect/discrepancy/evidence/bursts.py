"""Rare moments far above the noise: too few motions see them for evidence from motion to motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.settings import BURSTS
from gpcorrect.sim.effects import Effect


@dataclass(frozen=True)
class Burst:
    """A channel in which something rare happens, far above its noise, in trajectories as the log numbers them.

    `largest` is the largest residual there, `noise` the standard deviation of the noise, `rows` counts the condensed
    rows there that are above the limit, and `rare` says that the other trajectories are calm.
    """

    channel: Channel
    trajectories: tuple[int, ...]
    largest: float
    noise: float
    rows: int
    rare: bool

    @property
    def lasts(self) -> bool:
        """Whether it is rare and was long enough to be looked at in pieces: what has no name then is unknown."""
        return self.rare and self.rows >= BURSTS.pieces * BURSTS.shortest


def bursts_of(dataset: Dataset, noises: Sequence[ChannelNoise], effects: Sequence[Effect] = ()) -> tuple[Burst, ...]:
    """Return channels that are far above their noise in one of the trajectories: nothing of that size may be NONE.

    The test set counts as well: nothing is fitted to it, and "nothing is missing" must hold there too.

    Parameters
    ----------
    dataset : Dataset
    noises : sequence of ChannelNoise
    effects : sequence of Effect
        Beyond the model's own.
    """
    numbers, index = np.unique(dataset.trajectory, return_inverse=True)
    found = []
    for channel, column, noise in zip(dataset.scene.channels, dataset.residual(effects).T, noises, strict=True):
        known = np.isfinite(column)
        squares = np.bincount(index[known], column[known] ** 2, len(numbers))
        rms = np.sqrt(squares / np.maximum(np.bincount(index[known], minlength=len(numbers)), 1))
        above = rms > BURSTS.limit * noise.std
        if above.any():
            there = np.abs(column[above[index]])
            rows, calm = int((there > BURSTS.limit * noise.std).sum()), np.median(rms) <= BURSTS.calm * noise.std
            trajectories = tuple(numbers[above].tolist())
            found.append(Burst(channel, trajectories, float(np.nanmax(there)), noise.std, rows, bool(calm)))
    return tuple(found)
