"""Text exports of motion capture systems: header lines of their own, then lines of numbers with empty cells."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.csv_file import encoding_of
from gpcorrect.types import FloatArray

MISSING = frozenset({"", "nan", "-nan", "null", "na", "n/a", "none"})


@dataclass(frozen=True)
class Export:
    """A text file's lines."""

    lines: Sequence[str]  # counted from 0 here, from 1 in messages
    delimiter: str  # between cells

    def __len__(self) -> int:
        return len(self.lines)

    def cells(self, line: int) -> tuple[str, ...]:
        """Cells of a line, without blanks around them; empty cells at its end are left out, so an empty line has none.

        Parameters
        ----------
        line : int, counted from 0
        """
        cells = [cell.strip() for cell in next(csv.reader([self.lines[line]], delimiter=self.delimiter), [])]
        while cells and not cells[-1]:
            cells.pop()
        return tuple(cells)

    def samples(self, start: int, stop: int | None = None) -> list[int]:
        """Lines that hold anything, from one on to the one before another, or to the end of the file.

        Parameters
        ----------
        start, stop : int, counted from 0
        """
        blank = f"{self.delimiter} \t\r"
        found = [k for k, line in enumerate(self.lines[start:stop], start) if line.strip(blank)]
        if not found:
            raise LogError("the file has a header but no samples.")
        return found

    def numbers(self, lines: Sequence[int], columns: Sequence[int]) -> FloatArray:
        """Cells `(n, k)` of these lines and columns, NaN where a cell is empty or the line ends before it.

        Parameters
        ----------
        lines, columns : sequence of int, counted from 0
        """
        table = np.empty((len(lines), len(columns)))
        rows = csv.reader((self.lines[line] for line in lines), delimiter=self.delimiter)
        for k, row in enumerate(rows):
            for place, column in enumerate(columns):
                table[k, place] = self._number(row[column] if column < len(row) else "", lines[k], column)
        return table

    def _number(self, text: str, line: int, column: int) -> float:
        try:
            return float(text)  # blanks around it are allowed
        except ValueError:
            cell = text.strip()
        if cell.lower() in MISSING:
            return math.nan
        try:
            return float(cell.replace(",", "."))  # a comma inside a cell is a decimal one, whatever the delimiter
        except ValueError:
            raise LogError(f"expected a number in cell {column + 1} of line {line + 1}, got {cell!r}.") from None


def read_export(path: Path, delimiter: str | None = None) -> Export:
    """Read the lines of a file.

    Parameters
    ----------
    path : Path, a text export
    delimiter : str, optional, between cells; taken from the line that begins with "Frame" when not given
    """
    text = path.read_bytes().decode(encoding_of(path), errors="replace")
    lines = text.splitlines()
    heading = next((line.lstrip('"') for line in lines if line.lstrip('"').startswith("Frame")), "")
    export = Export(lines, delimiter or next((d for d in "\t;," if d in heading), ","))
    if len(lines) > 1 and not text.endswith(("\n", "\r")):
        last, before = (line.count(export.delimiter) for line in (lines[-1], lines[-2]))
        if last < before:
            raise LogError(f"the file is cut off inside line {len(lines)}.")
    return export


def seen_only(points: FloatArray) -> FloatArray:
    """Positions `(n, 3)` with those at exactly 0, 0, 0 as missing.

    No camera ever puts a point there: it is how several systems write a point that they do not see.

    Parameters
    ----------
    points : (n, 3) array, of one marker
    """
    return np.where((points == 0.0).all(axis=1, keepdims=True), np.nan, points)
