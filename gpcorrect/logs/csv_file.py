"""Text tables, with or without a header line."""

from __future__ import annotations

from functools import partial
from itertools import islice
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ColumnMap
from gpcorrect.logs.dialect import DECIMAL_COMMA, Dialect, sniff
from gpcorrect.logs.native import complete
from gpcorrect.logs.settings import ReadSettings, check_size
from gpcorrect.logs.table import Table, log_from_table
from gpcorrect.types import CalibrationLog

__all__ = ["read"]

MISSING = ["", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None"]


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a text table.

    Raises
    ------
    LogError
        The table is empty, too large, ragged, has text where numbers belong, or has no header and no mapping.
    """
    check_size(path, settings.max_bytes)
    dialect = sniff(path, settings.columns.csv)
    headless = dialect.names == tuple(str(k) for k in range(len(dialect.names)))
    if headless and not settings.mapped:
        raise LogError(
            f"the first line holds {len(dialect.names)} numbers and no column names.",
            hint="Give a mapping file with column numbers from 0, such as tracker_cp.position = [1, 2, 3].",
        )
    return log_from_table(_table(path, dialect, settings.columns), settings.columns, settings.disorder)


def _table(path: Path, dialect: Dialect, mapping: ColumnMap) -> Table:
    """All columns of numbers; columns of text are left out, unless the mapping needs them."""
    try:
        return _parse(path, dialect, ())
    except pa.ArrowInvalid as error:
        text = _text_columns(path, dialect, mapping)
        if not text:
            raise LogError(f"the table cannot be read: {error}.") from error
    return _parse(path, dialect, text)


def _parse(path: Path, dialect: Dialect, without: tuple[str, ...]) -> Table:
    wanted = [name for name in dialect.names if name not in without]
    encoding = "utf8" if dialect.encoding.startswith("utf-8") else dialect.encoding
    arrow = csv.read_csv(
        path,
        csv.ReadOptions(column_names=list(dialect.names), skip_rows=dialect.header_lines, encoding=encoding),
        csv.ParseOptions(delimiter=dialect.delimiter),
        csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.float64()),
            include_columns=wanted,
            null_values=MISSING,
            decimal_point=dialect.decimal,
        ),
    )
    columns = {name: arrow.column(name).to_numpy() for name in wanted}
    return Table(columns, partial(_line, path, dialect), without)


def _line(path: Path, dialect: Dialect, row: int) -> str:
    """Name the line of the file that holds a row; an editor opens it there."""
    with dialect.records(path) as records:
        number = next(islice((line for line, _ in records), row, None))
    return f"line {number}"


def _text_columns(path: Path, dialect: Dialect, mapping: ColumnMap) -> tuple[str, ...]:
    """Columns with a cell that is no number.

    Raises
    ------
    LogError
        A line has too few or too many cells, or a column that is needed holds text.
    """
    needed = _needed(dialect.names, mapping)
    text: dict[str, None] = {}
    with dialect.records(path) as records:
        for line, cells in records:
            if len(cells) != len(dialect.names):
                raise _ragged(line, len(cells), len(dialect.names))
            wrong = [
                (name, cell)
                for name, cell in zip(dialect.names, cells, strict=True)
                if name not in text and cell not in MISSING and not dialect.is_number(cell)
            ]
            for name, cell in wrong:
                if name in needed:
                    raise _not_a_number(name, line, cell)
                text[name] = None
    return tuple(text)


def _needed(names: tuple[str, ...], mapping: ColumnMap) -> set[str]:
    used = complete(mapping, names)[0].used
    numbered = {names[c] for c in used if isinstance(c, int) and c < len(names)}
    return numbered | {c for c in used if isinstance(c, str)}


def _ragged(line: int, got: int, expected: int) -> LogError:
    hint = (
        "The file may have been cut off."
        if got < expected
        else "Are there decimal commas? Say csv.delimiter and csv.decimal in a mapping file."
    )
    return LogError(f"line {line} has {got} cells, expected {expected}.", hint=hint)


def _not_a_number(column: str, line: int, cell: str) -> LogError:
    comma = DECIMAL_COMMA.fullmatch(cell) is not None
    hint = "Say csv.decimal = ',' in a mapping file." if comma else "Leave a missing cell empty."
    return LogError(f"column {column} must hold numbers, got {cell!r} at line {line}.", hint=hint)
