"""Rows side by side: motions of a log as padded columns, so that what runs along time runs over all at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpcorrect.types import BoolArray, FloatArray, IntArray

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each row of a table stands in a grid of n samples by N columns."""

    rows: IntArray  # (n, N) of the table, behind a column's end its last one again
    valid: BoolArray  # (n, N) true once for each row: not behind a column's end, nor where it warms up or runs out

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values as a grid `(n, N, ...)`.

        Parameters
        ----------
        values : (m, ...) array, of the table's rows
        """
        return values[self.rows]

    def gather(self, grid: NDArray[Value]) -> NDArray[Value]:
        """Return the values `(m, ...)` of the table's rows in a grid.

        Parameters
        ----------
        grid : (n, N, ...) array
        """
        return np.asarray(grid.reshape(-1, *grid.shape[2:])[self._cell_of_row])

    @cached_property
    def _cell_of_row(self) -> IntArray:
        cell = np.empty(int(self.valid.sum()), dtype=np.int64)
        cell[self.rows[self.valid]] = np.flatnonzero(self.valid)
        return cell


def layout_of(label: IntArray, *, piece: int, warm_up: int, run_out: int) -> Layout:
    """Lay the rows of each label side by side, in their order.

    Parameters
    ----------
    label : (m,) int array, of each row
    piece : int
        Labels of more than `piece + warm_up` rows may be cut into columns of `piece` rows. They are where that makes
        the grid smaller: one long label would pad the columns of many short ones.
    warm_up : int, rows before a cut that its column repeats, so that what has a memory fills it
    run_out : int, rows behind a cut that its column repeats, so that a motion cut there does not seem to stop at once
    """
    every = [np.flatnonzero(label == k) for k in np.unique(label)]
    whole = [(rows, 0, len(rows)) for rows in every]
    cut = [part for rows in every for part in _pieces(rows, piece, warm_up, run_out)]
    columns = min(whole, cut, key=lambda c: len(c) * max(len(rows) for rows, *_ in c))
    n = max(len(rows) for rows, *_ in columns)
    index = np.arange(n)
    rows = np.stack([np.pad(g, (0, n - len(g)), mode="edge") for g, *_ in columns], axis=1)
    valid = np.stack([(index >= begin) & (index < end) for _, begin, end in columns], axis=1)
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
