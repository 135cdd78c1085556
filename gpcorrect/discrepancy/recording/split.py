"""Trajectories are dealt once, before anything is looked at, to discovery, confirmation and test set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.settings import SPLIT
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, IntArray

NOT_USED = -1  # block of a row that is left out


@dataclass(frozen=True, eq=False)
class Split:
    """What rows are for; -1 marks rows left out."""

    block: IntArray  # (n,) trajectory of each row, or piece of a long one, that resampling keeps whole
    part: IntArray  # (n,) 0 discovery, 1 confirmation, 2 test
    remark: str  # how it was done

    def in_pieces(self, rows: BoolArray, length: int, rng: np.random.Generator) -> Split:
        """Return the split in which some rows are cut into short blocks, dealt anew: 3, 1 and 1 of five in a row.

        Parameters
        ----------
        rows : (n,) bool array, whole blocks
        length : int, rows of a piece
        rng : numpy.random.Generator
        """
        part, begins = self.part.copy(), np.r_[True, np.diff(self.block) != 0]
        within = [np.flatnonzero(rows & (self.block == b)) for b in np.unique(self.block[rows & (self.block >= 0)])]
        pieces = [p for own in within for p in np.array_split(own, max(1, len(own) // length))]
        dealt = np.concatenate([rng.permutation([0, 0, 0, 1, 2]) for _ in range(0, len(pieces), 5)])
        for piece, its in zip(pieces, dealt, strict=False):
            part[piece], begins[piece[0]] = its, True
        block = np.where(self.block >= 0, np.cumsum(begins), NOT_USED)  # numbered as they stand
        return Split(block, part, self.remark)


def split_rows(trajectory: IntArray, session: IntArray, rng: np.random.Generator) -> Split:
    """Deal rows 60 : 20 : 20 by session where there are three or more, by trajectory, or by blocks of a few long ones.

    Parameters
    ----------
    trajectory, session : (n,) int arrays
    rng : numpy.random.Generator

    Raises
    ------
    DataError
        There are too few rows to make three parts.
    """
    block, remark = _blocks(trajectory)
    used, n_sessions = block != NOT_USED, len(np.unique(session))
    by_session = n_sessions >= SPLIT.min_sessions
    if by_session:
        opening = "the opening of each in discovery: a homing is new every time"
        remark = f"split by session ({n_sessions} sessions), {opening}"
    unit = session if by_session else block
    units, first = np.unique(unit[used], return_index=True)
    if len(units) < SPLIT.min_sessions:
        raise DataError(
            f"the log has {len(units)} separate motions, a split into discovery, confirmation and test set needs 3.",
            hint="Record more trajectories, or longer ones.",
        )
    n_confirmation, n_test = (max(1, round(fraction * len(units))) for fraction in SPLIT.fractions[1:])
    part_of_unit = rng.permutation(np.repeat([2, 1, 0], [n_test, n_confirmation, len(units) - n_test - n_confirmation]))
    if n_sessions > 1 and not by_session:  # a homing is new in each: none of them in one part alone
        part_of_unit = _spread(part_of_unit, session[used][first], rng)
    part = np.full(len(trajectory), NOT_USED)
    part[used] = part_of_unit[np.searchsorted(units, unit[used])]
    if by_session:
        part[_openings(block, session)] = 0
    return Split(block, part, remark)


def _openings(block: IntArray, session: IntArray) -> BoolArray:
    """Rows of the first fifth of every session's blocks: what is new in it, a homing, must be learned somewhere."""
    opening = np.zeros(len(block), dtype=np.bool_)
    for number in np.unique(session):
        blocks = np.unique(block[(session == number) & (block != NOT_USED)])
        if len(blocks) > 1:
            opening |= (session == number) & np.isin(block, blocks[: max(1, round(SPLIT.opening * len(blocks)))])
    return opening


def _spread(parts: IntArray, session: IntArray, rng: np.random.Generator) -> IntArray:
    """Deal the same parts `(n,)` so that every session of the n units has its share of each."""
    place = np.concatenate([(np.arange(k) + rng.random()) / k for k in np.bincount(parts)])
    spread = np.empty_like(parts)
    spread[np.lexsort((rng.random(len(parts)), session))] = np.sort(parts)[np.argsort(place)]
    return spread


def _blocks(trajectory: IntArray) -> tuple[IntArray, str]:
    """Whole trajectories, or pieces of a few long ones with gaps between them, numbered as they stand; words on it."""
    numbers, first, inverse, counts = np.unique(trajectory, return_index=True, return_inverse=True, return_counts=True)
    order = np.argsort(first)
    inverse, counts = np.argsort(order)[inverse], counts[order]
    if len(numbers) >= SPLIT.min_units:
        return inverse.astype(np.int64), f"split by trajectory ({len(numbers)} trajectories)"
    pieces = np.maximum(1, np.round(counts / counts.sum() * 2 * SPLIT.min_units)).astype(np.int64)
    block, n_blocks = np.full(len(trajectory), NOT_USED), 0
    for number, count in enumerate(pieces):
        for piece in np.array_split(np.flatnonzero(inverse == number), count):
            guard = int(np.ceil(SPLIT.guard * len(piece))) if count > 1 else 0
            block[piece[: len(piece) - guard]] = n_blocks
            n_blocks += 1
    blocks = f"{n_blocks} contiguous blocks with {100 * SPLIT.guard:.0f} % guard gaps"
    return block, f"only {len(numbers)} trajectories: cut into {blocks}"
