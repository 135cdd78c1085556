"""Small structured tests: a residual that differs from cell to cell of one or two variables is not noise."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from gpcorrect.discrepancy.recording.covariates import Covariates
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Cells", "all_cells", "cells_of", "indicator"]

BINS = {1: 8, 2: 5}
MAX_TESTS = 150


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one test.

    Parameters
    ----------
    variables : tuple of str
        One or two of them.
    code : (n,) int array
        Cell of each row.
    words : tuple of str
        What each cell is.
    """

    variables: tuple[str, ...]
    code: IntArray
    words: tuple[str, ...]


def all_cells(covariates: Covariates) -> list[Cells]:
    """Return tests of every variable alone, and of the channel's own position and direction with every other one."""
    names = list(covariates.values)
    pairs = [(a, b) for a, b in combinations(names, 2) if a in covariates.primary or b in covariates.primary]
    wanted = [*((name,) for name in names), *pairs][:MAX_TESTS]
    return [cells_of({v: covariates.values[v] for v in variables}) for variables in wanted]


def cells_of(variables: dict[str, FloatArray]) -> Cells:
    """Cut one variable in 8 cells, or two in 5 by 5, that hold equally many rows.

    A variable of few values keeps them.
    """
    n_bins = BINS[len(variables)]
    codes, words = [], []
    for name, values in variables.items():
        code, names = _cut(values, n_bins)
        codes.append(code)
        words.append([f"{name} {w}" for w in names])
    if len(codes) == 1:
        return Cells(tuple(variables), codes[0], tuple(words[0]))
    first, second = words
    joint = tuple(f"{a}, {b}" for a in first for b in second)
    return Cells(tuple(variables), codes[0] * len(second) + codes[1], joint)


def _cut(values: FloatArray, n_bins: int) -> tuple[IntArray, list[str]]:
    distinct = np.unique(values)
    if len(distinct) <= n_bins:
        return np.searchsorted(distinct, values).astype(np.int64), [f"= {v:.3g}" for v in distinct]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, n_bins + 1)))
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return code.astype(np.int64), [f"{a:.3g} to {b:.3g}" for a, b in pairwise(edges)]


def indicator(cells: Cells, rows: IntArray) -> FloatArray:
    """Columns `(len(rows), k)`, one a cell that occurs among all cells, 1 where a row is in it."""
    columns = np.zeros((len(rows), len(cells.words)))
    columns[np.arange(len(rows)), cells.code[rows]] = 1.0
    return columns
