"""A self-contained HTML page of sections with sentences, tables, charts and figures, and of how it was made."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gpcorrect.atomic import write_file
from gpcorrect.calibration import command_line, now, versions
from gpcorrect.errors import MissingExtraError
from gpcorrect.plain import json_ready
from gpcorrect.report.charts import Chart, charts_data

try:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup
except ImportError as error:
    raise MissingExtraError("jinja2", extra="report", purpose="Writing a report page") from error


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
    path : Path
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
