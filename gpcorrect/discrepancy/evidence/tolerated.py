"""How much is put down to the tolerance of the arm's table and of the tracker's registration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.recording.noise import ChannelNoise

__all__ = ["MOST_TOLERATED", "tolerated"]

MOST_TOLERATED = 0.5  # of the noise: more of it may hide what is missing


def tolerated(bench: Bench, noises: Sequence[ChannelNoise]) -> dict[str, float]:
    """Root mean square of what is left out of account, as a share of each channel's noise; empty where nothing is."""
    if bench.scene.slack is None:
        return {}
    left_out = (bench.strict().residual() - bench.residual())[bench.seen]
    size = np.sqrt(np.nanmean(left_out**2, axis=0))
    return {c.name: float(s / n.std) for c, s, n in zip(bench.scene.channels, size, noises, strict=True)}
