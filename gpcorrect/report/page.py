"""A self-contained HTML page of sections with sentences, tables and figures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gpcorrect.atomic import write_file
from gpcorrect.errors import MissingExtraError

try:
    from jinja2 import Environment, PackageLoader, StrictUndefined
except ImportError as error:
    raise MissingExtraError("jinja2", extra="report", purpose="Writing a report page") from error

__all__ = ["FigureImage", "Page", "Section", "TableData", "write_page"]


@dataclass(frozen=True)
class TableData:
    """A table of ready text; the first column names the rows, the others but those in `text` are numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    text: Sequence[int] = ()


@dataclass(frozen=True)
class FigureImage:
    """A figure as PNG, or as another kind of picture, and the sentence under it: its alternative text too."""

    png: bytes
    caption: str
    kind: str = "png"

    @property
    def source(self) -> str:
        """Data address of the image, so that the page needs no other file."""
        return f"data:image/{self.kind};base64," + base64.b64encode(self.png).decode()


@dataclass(frozen=True)
class Section:
    """A heading, what it says, and its tables and figures."""

    title: str
    words: Sequence[str] = ()
    tables: Sequence[TableData] = ()
    figures: Sequence[FigureImage] = ()


@dataclass(frozen=True)
class Page:
    """A report: its verdict in one sentence first."""

    title: str
    verdict: str
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section] = field(default_factory=tuple)


def write_page(page: Page, path: Path) -> None:
    """Write the page atomically.

    Parameters
    ----------
    page : Page
    path : Path
        HTML file.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    environment = Environment(loader=PackageLoader("gpcorrect.report"), autoescape=True, undefined=StrictUndefined)
    html = environment.get_template("page.html").render(page=page)
    write_file(path, html)
