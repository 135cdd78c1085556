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
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Burst:
    """A channel in which something rare happens, far above its noise.

    Parameters
    ----------
    channel : Channel
        Which one.
    trajectories : tuple of int
        Numbers, as in the log, of those above the limit; never empty.
    largest, noise : float
        Largest residual there, and standard deviation of the noise, unit of the channel.
    rows : int
        Condensed rows of those trajectories that are above the limit.
    rare : bool
        Whether the other trajectories are calm.
    """

    channel: Channel
    trajectories: tuple[int, ...]
    largest: float
    noise: float
    rows: int = 0
    rare: bool = False

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
    residual, trajectory = dataset.residual(effects), dataset.trajectory
    found = []
    for channel, column, noise in zip(dataset.scene.channels, residual.T, noises, strict=True):
        limit = BURSTS.limit * noise.std
        size = {int(t): _rms(column[trajectory == t]) for t in np.unique(trajectory)}
        above = tuple(t for t, rms in size.items() if rms > limit)
        if not above:
            continue
        there = np.abs(column[np.isin(trajectory, above)])
        calm = float(np.median([*size.values()])) <= BURSTS.calm * noise.std
        rows = int((there > limit).sum())
        found.append(Burst(channel, above, float(np.nanmax(there)), noise.std, rows, calm))
    return tuple(found)


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
