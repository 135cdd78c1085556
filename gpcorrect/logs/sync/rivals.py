"""Several optima of the shift: which are the same, and which explain the recording as well as the best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.logs.sync.blocks import block_sums
from gpcorrect.logs.sync.refine import Refinement

__all__ = ["distinct", "equals"]

MIN_OVERLAP = 0.2  # of the samples must be common to two rivals to compare them sample by sample
RIVAL_LEVEL = 3.0  # standard errors by which the best fit must beat a rival
RIVAL_RATIO = 1.10  # and its loss must be better by this factor: a model error can be significant as well


def distinct(fits: Sequence[Refinement], apart: float) -> list[Refinement]:
    """Fits in order of what they explain, without those that settled beside a better one."""
    kept: list[Refinement] = []
    for fit in sorted(fits, key=lambda f: -f.explained):
        if all(abs(fit.timing[0] - k.timing[0]) > apart for k in kept):
            kept.append(fit)
    return kept


def equals(fits: Sequence[Refinement]) -> list[Refinement]:
    """Return the best fit and those that are as good, the smallest shift first."""
    best = [fits[0], *(f for f in fits[1:] if _as_good(f, fits[0]))]
    return sorted(best, key=lambda f: abs(float(f.timing[0])))


def _as_good(rival: Refinement, best: Refinement) -> bool:
    """Whether the best fit does not beat the rival clearly and significantly, on the samples of both if it can be."""
    loss, least = rival.loss(best.scale), best.loss(best.scale)
    both = rival.valid & best.valid
    if both.sum() < MIN_OVERLAP * best.valid.sum():
        return float(loss[rival.valid].mean()) < RIVAL_RATIO * float(least[best.valid].mean())
    a, b = loss[both], least[both]
    sums = block_sums((a - b)[:, None])[:, 0]
    error = float(np.sqrt(len(sums)) * sums.std(ddof=1))
    return float(sums.sum()) < RIVAL_LEVEL * error or float(a.sum()) < RIVAL_RATIO * float(b.sum())
