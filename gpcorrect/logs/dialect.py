"""How a text table is written: encoding, delimiter, decimal mark, header; taken from its first lines."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import CsvOptions

__all__ = ["DECIMAL_COMMA", "Dialect", "encoding_of", "is_number", "sniff"]

DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
LOOK_AHEAD = 20  # lines of data that are looked at for decimal commas
BYTE_ORDER_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}


@dataclass(frozen=True)
class Dialect:
    """A text table's form.

    Parameters
    ----------
    names : tuple of str
        A name for every column.
    header_lines : int
        Lines of the file before the first sample.
    delimiter, decimal, encoding : str
        As in the file.
    """

    names: tuple[str, ...]
    header_lines: int
    delimiter: str
    decimal: str
    encoding: str

    @contextmanager
    def records(self, path: Path) -> Iterator[Iterator[tuple[int, list[str]]]]:
        """Give an iterator over (line number, cells) of the samples, without empty lines."""
        with path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for _ in islice(file, self.header_lines):
                pass
            reader = csv.reader(file, delimiter=self.delimiter)
            yield ((self.header_lines + reader.line_num, cells) for cells in reader if cells)

    def is_number(self, cell: str) -> bool:
        """Whether a cell holds a number in this table's decimal mark."""
        return is_number(cell.replace(",", ".") if self.decimal == "," else cell)


def is_number(cell: str) -> bool:
    """Whether a cell holds a number; a missing one does not."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def sniff(path: Path, options: CsvOptions) -> Dialect:
    """Find out how a table is written, where the options do not say.

    Raises
    ------
    LogError
        The file is no text table, has no sample, or two columns of one name.
    """
    encoding = encoding_of(path)
    lines = _first_lines(path, encoding, options.skip)
    if not lines:
        raise LogError("expected a table, found no line of text.")
    number, first = lines[0]
    delimiter = options.delimiter or next((d for d in "\t;," if d in first), ",")
    rows = list(csv.reader((text for _, text in lines), delimiter=delimiter))
    decimal = options.decimal or _decimal(rows, delimiter)
    headed = _is_headed(rows[0], decimal) if options.header is None else options.header
    if headed and len(lines) == 1:
        raise LogError("the table has column names but no samples.")
    names = options.names or (_names(rows[0]) if headed else tuple(str(k) for k in range(len(rows[0]))))
    _check_names(names, len(rows[0]))
    return Dialect(names, number if headed else number - 1, delimiter, decimal, encoding)


def encoding_of(path: Path) -> str:
    """Tell the encoding of a text file by its byte order mark; UTF-8 without one.

    Raises
    ------
    LogError
        The file is binary.
    """
    with path.open("rb") as file:
        head = file.read(4096)
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding
    if b"\0" in head:
        raise LogError("expected a text table, found binary data.")
    return "utf-8"


def _first_lines(path: Path, encoding: str, skip: int) -> list[tuple[int, str]]:
    """(line number, text) of the header and a few samples, without empty lines."""
    with path.open(encoding=encoding, errors="replace", newline="") as file:
        numbered = ((n, line.rstrip("\r\n")) for n, line in enumerate(file, start=1) if n > skip)
        return list(islice(((n, line) for n, line in numbered if line.strip()), LOOK_AHEAD + 1))


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    comma = delimiter != "," and any(DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row)
    return "," if comma else "."


def _is_headed(cells: list[str], decimal: str) -> bool:
    dialect = Dialect((), 0, "", decimal, "")
    return not all(cell.strip() == "" or dialect.is_number(cell) for cell in cells)


def _names(cells: list[str]) -> tuple[str, ...]:
    """Names without blanks around them; a column without a name is called after its number."""
    return tuple(cell.strip() or f"column_{k}" for k, cell in enumerate(cells))


def _check_names(names: tuple[str, ...], width: int) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise LogError(f"the table has more than one column named {', '.join(twice)}.", hint="Rename them.")
    if len(names) != width:
        raise LogError(f"csv.names gives {len(names)} names, the table has {width} columns.")
