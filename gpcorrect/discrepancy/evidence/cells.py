"""Small structured tests: a residual that differs from cell to cell of one or two variables is not noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise, product

import numpy as np

from gpcorrect.discrepancy.recording.covariates import Covariates
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Cells", "Span", "all_cells", "cells_of", "indicator"]

BINS = {1: 8, 2: 5}
MAX_TESTS = 150


@dataclass(frozen=True)
class Span:
    """Where a cell lies along one variable: from `low` to `high`, which are the same for one of few values."""

    variable: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one test.

    Parameters
    ----------
    variables : tuple of str
        One or two of them.
    code : (n,) int array
        Cell of each row.
    spans : tuple of tuple of Span
        Where each cell lies, a span for each variable.
    """

    variables: tuple[str, ...]
    code: IntArray
    spans: tuple[tuple[Span, ...], ...]


def all_cells(covariates: Covariates) -> list[Cells]:
    """Return tests of every variable alone, and of the channel's own position and direction with every other one."""
    names = list(covariates.values)
    pairs = [(a, b) for a, b in combinations(names, 2) if a in covariates.primary or b in covariates.primary]
    wanted = [*((name,) for name in names), *pairs][:MAX_TESTS]
    return [cells_of({v: covariates.values[v] for v in variables}, covariates.units) for variables in wanted]


def cells_of(variables: Mapping[str, FloatArray], units: Mapping[str, str] | None = None) -> Cells:
    """Cut one variable in 8 cells, or two in 5 by 5, that hold equally many rows.

    A variable of few values keeps them. Variables without a unit are pure numbers.
    """
    n_bins = BINS[len(variables)]
    codes, spans = [], []
    for name, values in variables.items():
        code, ends = _cut(values, n_bins)
        codes.append(code)
        spans.append([Span(name, low, high, (units or {}).get(name, "")) for low, high in ends])
    if len(codes) == 1:
        return Cells(tuple(variables), codes[0], tuple((span,) for span in spans[0]))
    return Cells(tuple(variables), codes[0] * len(spans[1]) + codes[1], tuple(product(*spans)))


def _cut(values: FloatArray, n_bins: int) -> tuple[IntArray, list[tuple[float, float]]]:
    distinct = np.unique(values)
    if len(distinct) <= n_bins:
        return np.searchsorted(distinct, values).astype(np.int64), [(float(v), float(v)) for v in distinct]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, n_bins + 1)))
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return code.astype(np.int64), [(float(a), float(b)) for a, b in pairwise(edges)]


def indicator(cells: Cells, rows: IntArray) -> FloatArray:
    """Columns `(len(rows), k)`, one a cell that occurs among all cells, 1 where a row is in it."""
    columns = np.zeros((len(rows), len(cells.spans)))
    columns[np.arange(len(rows)), cells.code[rows]] = 1.0
    return columns
