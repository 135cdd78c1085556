"""A self-contained HTML page of sections with sentences, tables and charts, and of how it was made.

Charts are data: panels of series, which the page's script draws, zooms, turns and reads out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.atomic import write_file
from gpcorrect.calibration import command_line, now, versions
from gpcorrect.errors import MissingExtraError
from gpcorrect.plain import json_ready
from gpcorrect.types import FloatArray, IntArray

try:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup
except ImportError as error:
    raise MissingExtraError("jinja2", extra="report", purpose="Writing a report page") from error

DIGITS = 6  # of a number on the page: a thousand seconds to the millisecond or so; chosen by hand
NUMBERS = ("x", "y", "z", "x2", "y2", "value")
_Columns = dict[int, tuple[int, ArrayLike, list[float | None]]]
"""By an array's place in memory: its column's number, itself, so that no other gets that place, and the column."""


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
    """Numbers of one name; NaN leaves a gap."""

    name: str  # in the legend, which shows and hides all series of the name
    mark: Mark
    role: Role
    # (n,), in the units of the axes
    x: ArrayLike
    y: ArrayLike
    # third coordinate in space; other end of bars, bands and cells; colour of cells, or time of a point in space
    z: ArrayLike | None = None
    x2: ArrayLike | None = None
    y2: ArrayLike | None = None
    value: ArrayLike | None = None
    text: Sequence[str] = ()  # what is shown for each point, instead of the name
    labels: Sequence[str] = ()  # written beside each bar
    size: float = 0.0  # px of dots, or part of a row that a bar fills; as the page's script has it where 0
    hidden: bool = False  # not shown until the reader asks


@dataclass(frozen=True, eq=False)
class Panel:
    """Series on one pair of axes."""

    # name and, in brackets, unit
    x_label: str
    y_label: str
    series: Sequence[Series]
    z_label: str = ""
    title: str = ""
    # logarithmic scale
    log_x: bool = False
    log_y: bool = False
    equal: bool = False  # one scale for all axes
    rows: Sequence[str] = ()  # names of rows where y counts rows, from the top
    x_names: Sequence[str] = ()  # the same for x, from the left
    # shown at first; as the series need without it
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    spans: Sequence[tuple[float, float, str]] = ()  # stretches of x that are shaded, and why
    largest: float = 0.0  # value of cells in full colour
    height: int = 0  # px; by its contents where 0
    legend: bool = False  # name the series even where there is one


@dataclass(frozen=True, eq=False)
class Chart:
    """Panels and the sentence under them."""

    caption: str
    panels: Sequence[Panel] = ()  # of a chart that always shows the same
    # of a chart that shows what is chosen in the page's table, by the keys of its rows
    choices: Mapping[str, Sequence[Panel]] = field(default_factory=dict)
    columns: int = 1  # panels beside each other, on a wide page
    shared: bool = False  # the panels have one x axis: they are zoomed together
    space: bool = False  # one panel with x, y and z


def charts_data(charts: Sequence[Chart]) -> dict[str, Any]:
    """Return charts as the page's script reads them, JSON-able; an array that several series hold is written once.

    Parameters
    ----------
    charts : sequence of Chart
    """
    store: _Columns = {}
    return {
        "charts": [_plain(chart, store) for chart in charts],
        "columns": [column for _, _, column in store.values()],
    }


def runs(labels: np.ndarray) -> list[IntArray]:
    """Return the places of each unbroken run of one label.

    Parameters
    ----------
    labels : (n,) array
    """
    return np.split(np.arange(len(labels)), np.flatnonzero(labels[1:] != labels[:-1]) + 1)


def stretches(time: FloatArray, labels: np.ndarray) -> list[tuple[float, float, str]]:
    """Return from when to when samples have one label, s, and the label; of those without one nothing.

    Parameters
    ----------
    time, labels : (n,) arrays, s; text
    """
    half = float(np.median(np.diff(time))) / 2 if len(time) > 1 else 0.5
    found = [(run[0], run[-1]) for run in runs(labels) if labels[run[0]]]
    return [(float(time[a] - half), float(time[b] + half), str(labels[a])) for a, b in found]


def _column_of(array: ArrayLike, store: _Columns) -> int:
    """Return the number of an array's column, which is made when the array first comes."""
    if id(array) not in store:
        numbers = np.asarray(array, dtype=np.float64).tolist()
        # with the digits that can be seen; None for what is not finite
        column = [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in numbers]
        store[id(array)] = len(store), array, column
    return store[id(array)][0]


def _plain(part: Any, store: _Columns) -> Any:
    """Return a chart, panel or series as a dictionary of what it says; what it leaves open is left out."""
    found: dict[str, Any] = {}
    for entry in fields(part):
        value = getattr(part, entry.name)
        if value is None or (not isinstance(value, np.ndarray) and not value and entry.name not in NUMBERS):
            continue
        if isinstance(part, Series) and entry.name in NUMBERS:
            found[entry.name] = _column_of(value, store)
        elif entry.name == "choices":
            found[entry.name] = {key: [_plain(panel, store) for panel in panels] for key, panels in value.items()}
        elif entry.name in ("panels", "series"):
            found[entry.name] = [_plain(inner, store) for inner in value]
        else:
            found[entry.name] = value
    return found


@dataclass(frozen=True)
class TableData:
    """A table of ready text; the first column names the rows, the others but those in `text` are numbers.

    Rows with `keys` choose what the charts with choices show.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    text: Sequence[int] = ()
    keys: Sequence[str] = ()


@dataclass(frozen=True)
class Section:
    """A heading, what it says, and its tables and figures."""

    title: str
    words: Sequence[str] = ()
    tables: Sequence[TableData] = ()
    figures: Sequence[Chart] = ()


@dataclass(frozen=True)
class Page:
    """A report: its verdict in one sentence first."""

    title: str
    verdict: str
    facts: Sequence[tuple[str, str]]  # name and value, above all sections
    sections: Sequence[Section] = field(default_factory=tuple)
    sources: Sequence[tuple[str, str]] = ()  # for the foot of the page: data and models with their whole digests
    chosen: str = ""  # key of the row that charts with choices show first
    chooses: str = "trajectory"  # what a row with a key is, in the legend of these charts


def write_page(page: Page, path: Path) -> None:
    """Write the page atomically, with the date, the command line and the versions of this process at its foot.

    Parameters
    ----------
    page : Page
    path : Path, HTML file

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    charts = [figure for section in page.sections for figure in section.figures]
    data = json.dumps({**json_ready(charts_data(charts)), "chosen": page.chosen, "chooses": page.chooses})
    made = [
        ("written", now()),
        ("command", command_line()),
        ("versions", ", ".join(f"{name} {number}" for name, number in versions().items())),
    ]
    environment = Environment(loader=PackageLoader("gpcorrect.report"), autoescape=True, undefined=StrictUndefined)
    html = environment.get_template("page.html").render(
        page=page,
        charts=charts,
        data=Markup(data.replace("<", "\\u003c")),  # no tag can begin in it
        provenance=[*made, *page.sources],
    )
    write_file(path, html)
