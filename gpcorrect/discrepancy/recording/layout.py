"""Rows side by side: blocks of a log as padded columns, so that what runs along time runs over all blocks at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpcorrect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each row of a table stands in a grid of n samples by N columns.

    Parameters
    ----------
    rows : (n, N) int array
        Row of the table; behind a column's end its last row again.
    valid : (n, N) bool array
        False behind a column's end, and where a column only repeats rows of its neighbours to warm up and run out.
    """

    rows: IntArray
    valid: BoolArray

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values as a grid `(n, N, ...)`.

        Parameters
        ----------
        values : (m, ...) array
            Of the table's rows.
        """
        return values[self.rows]

    def gather(self, grid: FloatArray, n_rows: int) -> FloatArray:
        """Return the values `(n_rows, ...)` of the rows in a grid; NaN for rows that stand nowhere.

        Parameters
        ----------
        grid : (n, N, ...) array
            Values in the grid.
        n_rows : int
            Rows of the table.
        """
        if n_rows == len(self._cell_of_row) and self._every_row:
            whole: FloatArray = grid.reshape(-1, *grid.shape[2:])[self._cell_of_row]
            return whole
        values = np.full((n_rows, *grid.shape[2:]), np.nan)
        values[self.rows[self.valid]] = grid[self.valid]
        return values

    @cached_property
    def _cell_of_row(self) -> IntArray:
        """Where each row up to the last one prepared out stands in the flat grid; -1 for nowhere."""
        cell = np.full(int(self.rows.max(initial=-1)) + 1, -1)
        cell[self.rows[self.valid]] = np.flatnonzero(self.valid)
        return cell

    @cached_property
    def _every_row(self) -> bool:
        return bool((self._cell_of_row >= 0).all())


def layout_of(label: IntArray, *, piece: int | None = None, warm_up: int = 0, run_out: int = 0) -> Layout:
    """Lay the rows of each label side by side, in their order.

    Parameters
    ----------
    label : (m,) int array
        Of each row; rows of label -1 are left out.
    piece : int, optional
        Labels of more than `piece + warm_up` rows may be cut into columns of `piece` rows. They are where that makes
        the grid smaller: one long label would pad the columns of many short ones.
    warm_up : int
        Rows before a cut that its column repeats, so that what has a memory fills it.
    run_out : int
        Rows behind a cut that its column repeats, so that a motion cut there does not seem to stop at once.
    """
    whole = [(rows, 0, len(rows)) for rows in (np.flatnonzero(label == k) for k in np.unique(label[label >= 0]))]
    cut = [] if piece is None else [part for rows, *_ in whole for part in _pieces(rows, piece, warm_up, run_out)]
    groups = cut if cut and _cells(cut) < _cells(whole) else whole
    n = max((len(g) for g, *_ in groups), default=0)
    if n == 0:
        return Layout(np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0), dtype=np.bool_))
    index = np.arange(n)
    rows = np.stack([np.pad(g, (0, n - len(g)), mode="edge") for g, *_ in groups], axis=1)
    valid = np.stack([(index >= begin) & (index < end) for _, begin, end in groups], axis=1)
    return Layout(rows, valid)


def _pieces(rows: IntArray, piece: int, warm_up: int, run_out: int) -> list[tuple[IntArray, int, int]]:
    """Rows of each piece, and where those begin and end that do not only warm up or run out."""
    if len(rows) <= piece + warm_up:
        return [(rows, 0, len(rows))]
    parts = []
    for start in range(0, len(rows), piece):
        first, stop = max(0, start - warm_up), min(start + piece, len(rows))
        parts.append((rows[first : stop + run_out], start - first, stop - first))
    return parts


def _cells(groups: list[tuple[IntArray, int, int]]) -> int:
    return len(groups) * max(len(g) for g, *_ in groups)
