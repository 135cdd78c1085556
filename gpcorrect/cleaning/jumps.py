"""Pieces of a recording between impossible steps, and which of them can be one motion.

An occlusion shows as two false velocities around a block: an impossible step in and another out. Neither step tells
which side is wrong; the chain of pieces that hang together by possible steps and explain most samples does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpcorrect.cleaning.steps import Path, StepLimit, StepRuler
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Pieces", "excursions", "largest_chain", "split_pieces"]

REACH = 200  # pieces that a chain looks back
RETURN_SHARE = 0.3  # steps in and out that cancel to within this share are one excursion


@dataclass(frozen=True, eq=False)
class Pieces:
    """m stretches of samples without an impossible step.

    Parameters
    ----------
    label : (n,) int array
        Piece that each sample belongs to.
    first, last : (m,) int arrays
        First and last sample of each piece.
    run : (m,) int array
        Run that each piece lies in.
    ratio : (m,) array
        Step into the piece from the sample before, as a multiple of the largest possible; 0 at the start of a run.
    cause : (m,) int array
        Which limit that step breaks.
    """

    label: IntArray
    first: IntArray
    last: IntArray
    run: IntArray
    ratio: FloatArray
    cause: IntArray

    def __len__(self) -> int:
        return len(self.first)

    @property
    def counts(self) -> IntArray:
        """(m,) samples in each piece."""
        counts: IntArray = self.last - self.first + 1
        return counts


def split_pieces(path: Path, limits: Sequence[StepLimit]) -> Pieces:
    """Cut the samples where a run ends or a step breaks a limit."""
    n, run = len(path.samples), path.samples.run
    i = np.arange(n - 1)
    inside = run[1:] == run[:-1]
    ratios = np.zeros((n, len(limits)))
    for k, limit in enumerate(limits):
        ratios[1:, k][inside] = limit.ratio(path, i[inside], i[inside] + 1)
    worst = ratios.max(axis=1)
    starts = np.concatenate([[True], ~inside | (worst[1:] > 1.0)])
    first = np.flatnonzero(starts)
    last = np.append(first[1:], n) - 1
    label = np.cumsum(starts) - 1
    # A sample names the first limit that it breaks: a speed before a step of the error.
    cause = np.where(worst > 1.0, (ratios > 1.0).argmax(axis=1), 0)[first]
    return Pieces(label, first, last, run[first], ratios[first, cause], cause)


def largest_chain(
    pieces: Pieces, scores: FloatArray, path: Path, limits: Sequence[StepLimit], switch_cost: float
) -> BoolArray:
    """Mask (m,) of the pieces in the chain of greatest total score, a chain for each run.

    Neighbours in a chain are joined by a possible step, or by an impossible one at `switch_cost`. Pieces with a score
    that is not positive are in no chain.
    """
    kept = np.zeros(len(pieces), dtype=bool)
    for members in np.split(np.arange(len(pieces)), np.flatnonzero(np.diff(pieces.run)) + 1):
        members = members[scores[members] > 0]
        if len(members):
            kept[members[_best_chain(pieces, scores[members], members, path, limits, switch_cost)]] = True
    return kept


def _best_chain(
    pieces: Pieces, scores: FloatArray, members: IntArray, path: Path, limits: Sequence[StepLimit], switch_cost: float
) -> IntArray:
    """Positions within `members` of the best chain, by dynamic programming over the last `REACH` pieces."""
    best, before = scores.copy(), np.full(len(members), -1)
    for k in range(1, len(members)):
        low = max(0, k - REACH)
        i = pieces.last[members[low:k]]
        j = np.full(len(i), pieces.first[members[k]])
        possible = _possible(path, limits, i, j)
        gain = best[low:k] - np.where(possible, 0.0, switch_cost)
        choice = int(np.argmax(gain))
        if gain[choice] > 0:
            best[k] += gain[choice]
            before[k] = low + choice
    chain = [int(np.argmax(best))]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1])


def excursions(
    pieces: Pieces, candidates: BoolArray, path: Path, ruler: StepRuler, remainder: FloatArray, occlusion: float
) -> BoolArray:
    """Mask (m,) of the candidate pieces that lie between two impossible steps which cancel, found shortest first.

    Two independent steps do not cancel in three or six numbers; a marker that is lost and found again does that.
    Longer than an occlusion, it must also stand out: by half of the step or more from what the smooth model expects.

    Parameters
    ----------
    pieces, candidates : Pieces, (m,) bool array
        All pieces, and those that may be motions.
    path, ruler : Path, StepRuler
        Samples and what they can do.
    remainder : (n, k) array
        What the smooth model leaves of the error, in any unit.
    occlusion : float
        Samples of the longest occlusion.
    """
    dropped = np.zeros(len(pieces), dtype=bool)
    stretches = _stretches(pieces, np.flatnonzero(candidates), path, ruler.limits)
    while (inside := _shortest_excursion(stretches, path, ruler, remainder, occlusion)) is not None:
        dropped[[piece for stretch in stretches[inside] for piece in stretch.pieces]] = True
        stretches = _without(stretches, inside, path, ruler.limits)
    return dropped


@dataclass(frozen=True)
class _Stretch:
    """Pieces of one run that are one motion: from sample `first` to sample `last`, `count` samples in all."""

    first: int
    last: int
    count: int
    pieces: list[int]
    run: int

    def joined(self, later: _Stretch) -> _Stretch:
        return _Stretch(self.first, later.last, self.count + later.count, self.pieces + later.pieces, self.run)


def _stretches(pieces: Pieces, chosen: IntArray, path: Path, limits: Sequence[StepLimit]) -> list[_Stretch]:
    """Join neighbours where the step between them is possible."""
    stretches: list[_Stretch] = []
    for k in chosen:
        first, last = int(pieces.first[k]), int(pieces.last[k])
        _append(stretches, _Stretch(first, last, last - first + 1, [int(k)], int(pieces.run[k])), path, limits)
    return stretches


def _without(stretches: list[_Stretch], inside: slice, path: Path, limits: Sequence[StepLimit]) -> list[_Stretch]:
    """Take some stretches out, and join those around them where the step is possible: no impossible step is left."""
    left, after = stretches[: inside.start], stretches[inside.stop :]
    _append(left, after[0], path, limits)
    return left + after[1:]


def _append(stretches: list[_Stretch], new: _Stretch, path: Path, limits: Sequence[StepLimit]) -> None:
    """Append a stretch, as a part of the last one where the step from that is possible."""
    before = stretches[-1] if stretches else None
    if before and before.run == new.run and _possible(path, limits, np.array([before.last]), np.array([new.first]))[0]:
        stretches[-1] = before.joined(new)
    else:
        stretches.append(new)


def _shortest_excursion(
    stretches: list[_Stretch], path: Path, ruler: StepRuler, remainder: FloatArray, occlusion: float
) -> slice | None:
    """Positions of the fewest samples that are left as they were entered, with pauses but no other steps between."""
    scaled = path.error / np.repeat(ruler.noise, 3)
    inner = [k for k, (a, b) in enumerate(pairwise(stretches)) if a.run == b.run]
    found = []
    for a, b in pairwise(inner):
        step_in, step_out = (scaled[stretches[k + 1].first] - scaled[stretches[k].last] for k in (a, b))
        height = min(np.linalg.norm(step_in), np.linalg.norm(step_out))
        inside = slice(a + 1, b + 1)
        count = sum(stretch.count for stretch in stretches[inside])
        if (
            np.linalg.norm(step_in + step_out) <= 0.5 + RETURN_SHARE * height
            and count < len(remainder) / 2
            and (count <= occlusion or _stands_out(stretches[a : b + 2], remainder))
        ):
            found.append((count, inside))
    return min(found, key=lambda excursion: excursion[0])[1] if found else None


def _stands_out(stretches: list[_Stretch], remainder: FloatArray) -> bool:
    """Whether the smooth model misses all but the outer stretches by half of the steps that bound them, or more."""
    before, *inner, after = stretches
    step_in = remainder[inner[0].first] - remainder[before.last]
    step_out = remainder[after.first] - remainder[inner[-1].last]
    step = (step_in - step_out) / 2
    inside = np.vstack([remainder[s.first : s.last + 1] for s in inner])
    outside = np.vstack([remainder[s.first : s.last + 1] for s in (before, after)])
    return bool((np.median(inside, axis=0) - np.median(outside, axis=0)) @ step >= 0.5 * (step @ step))


def _possible(path: Path, limits: Sequence[StepLimit], i: IntArray, j: IntArray) -> BoolArray:
    """(m,) mask of the steps from samples i to samples j that break no limit."""
    possible: BoolArray = np.max([limit.ratio(path, i, j) for limit in limits], axis=0) <= 1.0
    return possible
