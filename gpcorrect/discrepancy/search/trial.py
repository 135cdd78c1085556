"""A set of effects tried on the data.

Its signatures and tangents through the simulator, its refinement, its held-out nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gpcorrect.discrepancy.evidence.lens import Lens
from gpcorrect.discrepancy.evidence.linear import fold_of, solve
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.instants import has_instant, with_best_instant
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["FOLDS", "Trial", "held_out", "refine", "signature", "tangents", "try_set"]

FOLDS = 5
STEP = 0.002  # of a coordinate, for finite differences: far below a wave's turn over the range of a joint
SMALLEST_STEP = 5e-4
MAX_EVALUATIONS = 8


def signature(bench: Bench, base: FloatArray, others: Sequence[Member], candidate: Candidate) -> FloatArray | None:
    """Change of the channels `(m, c, a)` when a candidate is inserted at its start.

    A column for each amplitude (or one).

    `base` are the channels `(m, c)` without it. None when the simulator refuses the effect on this machine.
    """
    indices = candidate.amplitudes or (-1,)
    columns = []
    for i in indices:
        try:
            effect = candidate.build(candidate.single(i))
            columns.append(bench.predict([*(m.effect for m in others), effect]) - base)
        except DataError:
            return None
    return np.stack(columns, axis=2)


def tangents(bench: Bench, fixed: Sequence[Member], free: Sequence[Member]) -> tuple[FloatArray, FloatArray]:
    """Channels `(m, c)` of a set, and their derivatives `(m, c, p)` along every coordinate of its free members."""
    at = bench.predict([m.effect for m in (*fixed, *free)])
    columns = []
    for i, member in enumerate(free):
        low, high = np.array([c.bounds for c in member.candidate.coordinates]).T
        for j, u in enumerate(member.u):
            if member.candidate.coordinates[j].parameter.change_point:  # no slope
                columns.append(np.zeros(at.shape))
                continue
            step = max(STEP * abs(u), SMALLEST_STEP)
            step = step if u + step <= high[j] else -step
            moved = np.array(member.u)
            moved[j] = max(u + step, low[j])
            others = [*fixed, *free[:i], Member(member.candidate, moved), *free[i + 1 :]]
            columns.append((bench.predict([m.effect for m in others]) - at) / (moved[j] - u))
    return at, np.stack(columns, axis=2) if columns else np.zeros((*at.shape, 0))


def refine(
    bench: Bench,
    lens: Lens,
    observed: FloatArray,
    fixed: Sequence[Member],
    free: Sequence[Member],
    evaluations: int = MAX_EVALUATIONS,
) -> list[Member]:
    """Fit the free members' numbers by bounded least squares through the simulator; the fixed ones stay.

    Parameters
    ----------
    bench, lens : Bench, Lens
        Data, and how they are seen.
    observed : (m, c) array
        Measured channels, condensed.
    fixed, free : sequences of Member
        The set.
    evaluations : int
        Of the set, at most.

    Returns
    -------
    list of Member
        The free ones with their new numbers.
    """
    free = _with_best_instants(bench, lens, observed, fixed, free)
    coordinates = [c for m in free for c in m.candidate.coordinates]
    if not coordinates:
        return []
    low, high = np.array([c.bounds for c in coordinates]).T
    start = np.clip(np.concatenate([m.u for m in free]), low, high)

    def errors(u: FloatArray) -> FloatArray:
        at = bench.predict([m.effect for m in (*fixed, *_at(free, u))])
        prior = [c.prior_residual(x) for c, x in zip(coordinates, u, strict=True)]
        return np.concatenate([lens.look_one(observed - at), prior])

    def jacobian(u: FloatArray) -> FloatArray:
        slopes = -lens.look(tangents(bench, fixed, _at(free, u))[1])
        prior = np.diag([1.0 if c.prior_residual(1.0) else 0.0 for c in coordinates])
        prior *= 1.0 / np.log(3.0)
        return np.concatenate([slopes, prior])

    inner = np.clip(start, np.nextafter(low, high), np.nextafter(high, low))
    fit = least_squares(errors, inner, jac=jacobian, bounds=(low, high), x_scale=1.0, max_nfev=evaluations, ftol=1e-5)
    return _at(free, fit.x)


def _with_best_instants(
    bench: Bench, lens: Lens, observed: FloatArray, fixed: Sequence[Member], free: Sequence[Member]
) -> list[Member]:
    members = list(free)
    for i, member in enumerate(members):
        if has_instant(member):
            others = [*fixed, *members[:i], *members[i + 1 :]]
            members[i] = with_best_instant(bench, lens, observed, others, member)
    return members


def _at(members: Sequence[Member], u: FloatArray) -> list[Member]:
    ends = np.cumsum([len(m.u) for m in members])
    return [Member(m.candidate, part) for m, part in zip(members, np.split(u, ends[:-1]), strict=True)]


@dataclass(frozen=True, eq=False)
class Trial:
    """A set with what it explains.

    Parameters
    ----------
    members : tuple of Member
        The set.
    z : (M,) array
        Seen residual that it leaves.
    slopes : (M, p) array
        Seen tangents of the coordinates of its free members.
    """

    members: tuple[Member, ...]
    z: FloatArray
    slopes: FloatArray


def try_set(
    bench: Bench, lens: Lens, observed: FloatArray, free: Sequence[Member], fixed: Sequence[Member] = ()
) -> Trial:
    """Take residual and tangents of a set as this lens sees them; the numbers of the fixed members stay."""
    at, slopes = tangents(bench, fixed, free)
    return Trial((*fixed, *free), lens.look_one(observed - at), lens.look(slopes))


def held_out(lens: Lens, reference: FloatArray, z: FloatArray, slopes: FloatArray) -> FloatArray:
    """Nats `(b,)` of each block that a set gains over a reference residual.

    Its numbers refitted (to first order) without the block's fold.

    Parameters
    ----------
    lens : Lens
        That made the columns.
    reference, z : (M,) arrays
        Seen residual without the set, and with it at its best numbers.
    slopes : (M, p) array
        Its seen tangents.
    """
    block = lens.block
    n_blocks = int(block.max()) + 1
    before, after = np.bincount(block, reference**2, n_blocks), np.bincount(block, z**2, n_blocks)
    gains: FloatArray = 0.5 * (before - after).astype(np.float64)
    if slopes.shape[1] == 0:
        return gains
    sums = lens.grams(slopes, z)
    fold = fold_of(n_blocks, FOLDS)
    numbers = np.unique(fold)
    gram = sums.gram.sum(axis=0) - np.stack([sums.gram[fold == k].sum(axis=0) for k in numbers])
    moment = sums.moment.sum(axis=0) - np.stack([sums.moment[fold == k].sum(axis=0) for k in numbers])
    shift = solve(gram, moment, ridge=1e-4)[np.searchsorted(numbers, fold)]
    gains += (shift * (sums.moment - 0.5 * (sums.gram @ shift[..., None])[..., 0])).sum(axis=1)
    return gains
