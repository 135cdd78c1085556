"""Rare loud moments: a channel that in a few motions is far from what its noise mostly is.

Too rare for a name that must hold on motions not seen, and too loud for "nothing is missing".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.recording.noise import ChannelNoise

__all__ = ["Burst", "bursts_of"]

BURST = 3.0  # noise levels


@dataclass(frozen=True)
class Burst:
    """A channel in which something rare happens.

    Parameters
    ----------
    channel : str
        Its name.
    trajectories : tuple of int
        Numbers, as in the log, of those that are louder than the limit; never empty.
    largest : float
        Largest residual there.
    noise : float
        Standard deviation of the channel's noise, in the same unit.
    unit : str
        "rad" or "m".
    """

    channel: str
    trajectories: tuple[int, ...]
    largest: float
    noise: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for report.json."""
        return asdict(self) | {"trajectories": list(self.trajectories)}


def bursts_of(bench: Bench, noises: Sequence[ChannelNoise]) -> tuple[Burst, ...]:
    """Channels that are far louder than their noise in one of the parts, and in which trajectories.

    The sealed part counts as well: nothing is fitted to it, and "nothing is missing" must hold there too.
    """
    residual, part = bench.residual(), bench.part
    first = np.unique(bench.group[bench.group >= 0], return_index=True)[1]
    trajectory = bench.scene.trajectory[np.flatnonzero(bench.group >= 0)[first]]
    found = []
    for channel, column, noise in zip(bench.scene.channels, residual.T, noises, strict=True):
        limit = BURST * noise.std
        if all(_rms(column[part == p]) <= limit for p in np.unique(part)):
            continue
        size = {int(t): _rms(column[trajectory == t]) for t in np.unique(trajectory)}
        loud = [t for t, rms in size.items() if rms > limit] or [max(size, key=lambda t: size[t])]
        found.append(Burst(channel.name, tuple(loud), float(np.nanmax(np.abs(column))), noise.std, channel.unit))
    return tuple(found)


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
