"""Rows side by side: blocks of a log as padded columns, so that what runs along time runs over all blocks at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Layout", "layout_of"]


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each row of a table stands in a grid of n samples by N blocks.

    Parameters
    ----------
    rows : (n, N) int array
        Row of the table; behind a block's end its last row again.
    valid : (n, N) bool array
        False behind a block's end.
    """

    rows: IntArray
    valid: BoolArray

    def spread(self, values: FloatArray) -> FloatArray:
        """Values `(m, ...)` of the table's rows as a grid `(n, N, ...)`."""
        return values[self.rows]

    def gather(self, grid: FloatArray, n_rows: int) -> FloatArray:
        """Values `(n_rows, ...)` of the rows in a grid `(n, N, ...)`; NaN for rows that are in no block."""
        values = np.full((n_rows, *grid.shape[2:]), np.nan)
        values[self.rows[self.valid]] = grid[self.valid]
        return values


def layout_of(label: IntArray) -> Layout:
    """Lay the rows of each label side by side, in their order; rows of label -1 are left out."""
    groups = [np.flatnonzero(label == k) for k in np.unique(label[label >= 0])]
    n = max((len(g) for g in groups), default=0)
    rows = np.stack([np.pad(g, (0, n - len(g)), mode="edge") for g in groups], axis=1) if groups else np.zeros((0, 0))
    valid = np.stack([np.arange(n) < len(g) for g in groups], axis=1) if groups else np.zeros((0, 0))
    return Layout(rows.astype(np.int64), valid.astype(np.bool_))
