"""Charts of a page as data: panels of series, which the page's script draws, zooms, turns and reads out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

DIGITS = 6
"""Of a number on the page: a thousand seconds to the millisecond or so; chosen by hand."""


class Mark(StrEnum):
    """How a series is drawn."""

    LINE = "line"
    DASH = "dash"
    BAND = "band"  # from y to y2
    DOTS = "dots"
    CROSSES = "crosses"
    BARS = "bars"  # from x to x2, y is the row's number
    CELLS = "cells"  # from x to x2 and y to y2, coloured by `value`


class Role(StrEnum):
    """What a series stands for; the page gives each a colour, light and dark, that colour-blind readers keep apart."""

    RAW = "raw"
    RIGID = "rigid"
    CORRECTED = "corrected"
    DROPPED = "dropped"
    GOOD = "good"
    SKY = "sky"
    QUIET = "quiet"
    INK = "ink"


@dataclass(frozen=True, eq=False)
class Series:
    """Numbers of one name; NaN leaves a gap.

    Parameters
    ----------
    name : str
        In the legend, which shows and hides all series of the name.
    mark : Mark
    role : Role
    x, y : array_like
        (n,), in the units of the axes.
    z, x2, y2, value : array_like or None
        Third coordinate in space; other end of bars, bands and cells; colour of cells, or time of a point in space.
    text : sequence of str
        What is shown for each point, instead of the name.
    labels : sequence of str
        Written beside each bar.
    size : float
        px of dots, or part of a row that a bar fills; as the page's script has it where 0.
    hidden : bool
        Not shown until the reader asks.
    """

    name: str
    mark: Mark
    role: Role
    x: ArrayLike
    y: ArrayLike
    z: ArrayLike | None = None
    x2: ArrayLike | None = None
    y2: ArrayLike | None = None
    value: ArrayLike | None = None
    text: Sequence[str] = ()
    labels: Sequence[str] = ()
    size: float = 0.0
    hidden: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Series on one pair of axes.

    Parameters
    ----------
    x_label, y_label, z_label : str
        Name and, in brackets, unit.
    series : sequence of Series
    title : str
    log_x, log_y : bool
        Logarithmic scale.
    equal : bool
        One scale for all axes.
    rows : sequence of str
        Names of rows where y counts rows, from the top.
    x_names : sequence of str
        The same for x, from the left.
    x_range, y_range : (float, float) or None
        Shown at first; as the series need without it.
    spans : sequence of (float, float, str)
        Stretches of x that are shaded, and why.
    largest : float
        Value of cells in full colour.
    height : int
        px; by its contents where 0.
    legend : bool
        Name the series even where there is one.
    """

    x_label: str
    y_label: str
    series: Sequence[Series]
    z_label: str = ""
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    equal: bool = False
    rows: Sequence[str] = ()
    x_names: Sequence[str] = ()
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    spans: Sequence[tuple[float, float, str]] = ()
    largest: float = 0.0
    height: int = 0
    legend: bool = False


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels and the sentence under them.

    Parameters
    ----------
    caption : str
    panels : sequence of Panel
        Of a chart that always shows the same.
    choices : mapping of str to sequence of Panel
        Of a chart that shows what is chosen in the page's table, by the keys of its rows.
    columns : int
        Panels beside each other, on a wide page.
    shared : bool
        The panels have one x axis: they are zoomed together.
    space : bool
        One panel with x, y and z.
    """

    caption: str
    panels: Sequence[Panel] = ()
    choices: Mapping[str, Sequence[Panel]] = field(default_factory=dict)
    columns: int = 1
    shared: bool = False
    space: bool = False


def charts_data(charts: Sequence[Chart]) -> dict[str, Any]:
    """Return charts as the page's script reads them, JSON-able; an array that several series hold is written once.

    Parameters
    ----------
    charts : sequence of Chart
        In the order of the page.
    """
    store = _Columns()
    return {"charts": [_plain(chart, store) for chart in charts], "columns": store.lists}


class _Columns:
    """Lists of numbers, one for each array that was given."""

    def __init__(self) -> None:
        self.lists: list[list[float | None]] = []
        self._known: dict[int, int] = {}
        self._held: list[ArrayLike] = []  # so that no other array gets its place in memory, and its number

    def number(self, array: ArrayLike) -> int:
        if id(array) not in self._known:
            self._known[id(array)] = len(self.lists)
            self._held.append(array)
            self.lists.append(_rounded(np.asarray(array, dtype=np.float64)))
        return self._known[id(array)]


NUMBERS = ("x", "y", "z", "x2", "y2", "value")


def _plain(part: Any, store: _Columns) -> Any:
    """Return a chart, panel or series as a dictionary of what it says; what it leaves open is left out."""
    found: dict[str, Any] = {}
    for entry in fields(part):
        value = getattr(part, entry.name)
        if value is None or (not isinstance(value, np.ndarray) and not value and entry.name not in NUMBERS):
            continue
        if isinstance(part, Series) and entry.name in NUMBERS:
            found[entry.name] = store.number(value)
        elif entry.name == "choices":
            found[entry.name] = {key: [_plain(panel, store) for panel in panels] for key, panels in value.items()}
        elif entry.name in ("panels", "series"):
            found[entry.name] = [_plain(inner, store) for inner in value]
        else:
            found[entry.name] = value
    return found


def _rounded(values: Any) -> list[float | None]:
    """Return numbers with the digits that can be seen; None for what is not finite."""
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in values]
