"""How well a set's numbers are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.lens import Lens
from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.search.trial import try_set
from gpcorrect.types import FloatArray

__all__ = ["explained_by_others", "half_widths"]


def half_widths(search: Search, lens: Lens, members: Sequence[Member], index: int) -> dict[int, float]:
    """Half widths of the 95 % intervals of one member's coordinates.

    The larger of sandwich (by trajectory) and Gauss-Newton.

    Notes
    -----
    Sandwich with whole trajectories as units: Liang and Zeger 1986, Biometrika 73(1).
    """
    trial = try_set(search.bench, lens, search.observed, members)
    block = lens.block
    n_blocks = int(block.max()) + 1
    inverse = np.linalg.pinv(trial.slopes.T @ trial.slopes, hermitian=True)
    scores = np.stack([trial.slopes[block == b].T @ trial.z[block == b] for b in range(n_blocks)])
    meat = scores.T @ scores * n_blocks / max(n_blocks - 1, 1)
    variance = np.maximum(np.diag(inverse @ meat @ inverse), np.diag(inverse))
    half = student.ppf(0.975, max(n_blocks - 1, 1)) * np.sqrt(variance)
    begin = sum(len(m.u) for m in members[:index])
    return {i: float(half[begin + i]) for i in range(len(members[index].u))}


def explained_by_others(search: Search, members: Sequence[Member], index: int) -> float:
    """Share of a member's tangent (along its amplitude) that the other members' tangents make up."""
    slopes = try_set(search.bench, search.lens, search.observed, members).slopes
    ends = np.cumsum([0, *(len(m.u) for m in members)])
    own = slopes[:, ends[index] + members[index].candidate.sizes[0]]
    others = np.delete(slopes, np.arange(ends[index], ends[index + 1]), axis=1)
    if others.shape[1] == 0 or not own.any():
        return 0.0
    left: FloatArray = own - others @ solve(others.T @ others, others.T @ own)
    return 1.0 - float(left @ left / (own @ own))
