"""Guilt by association: samples, and whole trajectories, nearly all of whose company is rejected."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["SURROUNDED", "rejected_nearby", "rejected_shares"]

NEARBY = 8  # samples on either side
SURROUNDED = 0.6  # share of them beyond which what is left is no motion


def rejected_shares(trajectory: IntArray, keep: BoolArray) -> dict[int, float]:
    """Share of rejected samples of each trajectory: above P % it is dropped whole (Mahler 2014, Sec. IV-A)."""
    numbers, index = np.unique(trajectory, return_inverse=True)
    shares = np.bincount(index, weights=~keep) / np.bincount(index)
    return dict(zip(numbers.tolist(), shares.tolist(), strict=True))


def rejected_nearby(run: IntArray, keep: BoolArray) -> FloatArray:
    """Share (n,) of rejected samples among each sample's neighbours in its run, eight on either side.

    In a stretch that is shuffled, a few samples lie by chance where they should; they are no motion.
    """
    n = len(run)
    bounds = np.flatnonzero(np.concatenate([[True], np.diff(run) != 0, [True]]))
    stretch = np.searchsorted(bounds, np.arange(n), side="right") - 1
    low = np.maximum(np.arange(n) - NEARBY, bounds[stretch])
    high = np.minimum(np.arange(n) + NEARBY + 1, bounds[stretch + 1])
    rejected = np.concatenate([[0], np.cumsum(~keep)])
    share: FloatArray = (rejected[high] - rejected[low] - ~keep) / np.maximum(high - low - 1, 1)
    return share
