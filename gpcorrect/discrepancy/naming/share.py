"""How much of the gap is closed where an effect shows: one that leaves most of it is a part of something else."""

from __future__ import annotations

import numpy as np

from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["LEAST_SHARE", "share_closed"]

LEAST_SHARE = 0.4  # of the mean square above noise
PLAIN = 1.25  # noise levels: what is left above is no noise


def share_closed(search: Search, member: Member) -> float:
    """Share of the mean square above noise that the set closes in a member's channels, the best of them.

    On discovery and confirmation, sample by sample. 1 where what is left may be noise.
    """
    rows = search.bench.seen
    before, after = (_mean_square(search.residual(members), rows) for members in ((), search.members))
    noise = np.array([n.std for n in search.lens.noises]) ** 2
    change = _mean_square(search.bench.predict([member.effect]) - search.bench.predict(), rows)
    touched = search.touched(member.candidate) & (change > 0.0)
    if not touched.any():
        return 1.0
    loudest = int(np.argmax(np.where(touched, change / noise, -1.0)))
    if after[loudest] <= PLAIN**2 * noise[loudest]:
        return 1.0
    worth = touched & (before > noise)
    closed = 1.0 - (after - noise)[worth] / (before - noise)[worth]
    return float(np.max(closed, initial=0.0))


def _mean_square(values: FloatArray, rows: BoolArray) -> FloatArray:
    return np.asarray(np.nanmean(values[rows] ** 2, axis=0))
