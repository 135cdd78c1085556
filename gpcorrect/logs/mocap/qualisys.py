"""TSV exports of Qualisys Track Manager: markers (3D) or rigid bodies (6D), in millimetres.

Lines of a key and its values (`NO_OF_FRAMES`, `FREQUENCY`, `DATA_INCLUDED`, `MARKER_NAMES` or `BODY_NAMES`, ...), an
optional line of column names, then the samples, before which frame and time may stand. A body has 16 columns: position,
three angles of a convention that the user chose, residual, and the rotation matrix column by column, which is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import METRES, Body, Take
from gpcorrect.logs.mocap.text import read_export, seen_only
from gpcorrect.logs.orientation import CONVERTERS
from gpcorrect.types import FloatArray, PoseSignal

MARKS = (b"NO_OF_FRAMES\t", b"FILE_VERSION\t")
WIDTH = {"3D": 3, "6D": 16}  # columns of a marker or body
RESIDUAL, MATRIX = 6, slice(7, 16)  # columns of a body
BY_ROWS = [0, 3, 6, 1, 4, 7, 2, 5, 8]  # from a matrix written column by column


def read(path: Path, settings: ReadSettings) -> Take:
    """Read rigid bodies, or markers."""
    export = read_export(path, "\t")
    start = next((k for k in range(len(export)) if _begins_samples(export.cells(k))), len(export))
    header = {cells[0]: cells[1:] for cells in map(export.cells, range(start)) if cells}
    kind = "".join(header.get("DATA_INCLUDED", ())[:1])
    names = header.get("BODY_NAMES" if kind == "6D" else "MARKER_NAMES", ())
    if kind not in WIDTH or not names or len(set(names)) < len(names):
        raise LogError("expected DATA_INCLUDED 3D or 6D and different MARKER_NAMES or BODY_NAMES in Qualisys' TSV.")
    lines = export.samples(start)
    width = max(len(export.cells(k)) for k in lines)
    clock = 2 if "Frame" in header else (width % WIDTH[kind]) % 3
    if not clock:  # a line of tabs alone is a frame that shows nothing
        lines = [k for k in range(start, lines[-1] + 1) if export.lines[k]]
    table = export.numbers(lines, range(width))
    if clock == 2:
        time = table[:, 1]
    else:  # the frame's number, or the row's, at the stated rate
        try:
            rate = float(header["FREQUENCY"][0])
        except (KeyError, IndexError, ValueError):
            rate = 0.0
        if not rate > 0:
            raise LogError("expected FREQUENCY in Hz in the header of Qualisys' TSV.")
        time = (table[:, 0] if clock else np.arange(len(table))) / rate
    needed = clock + WIDTH[kind] * len(names)
    values = np.full((len(table), needed), np.nan)
    values[:, : min(width, needed)] = table[:, :needed]
    parts = np.split(values[:, clock:], len(names), axis=1)
    if kind == "3D":
        markers = {name: seen_only(part * METRES["mm"]) for name, part in zip(names, parts, strict=True)}
        return Take(time, markers=markers, tracker="Qualisys")
    return Take(time, bodies={n: _body(part) for n, part in zip(names, parts, strict=True)}, tracker="Qualisys")


def _begins_samples(cells: Sequence[str]) -> bool:
    try:
        return bool(cells) and np.isfinite(float(cells[0].replace(",", ".")))
    except ValueError:
        return False


def _body(part: FloatArray) -> Body:
    position = seen_only(part[:, :3] * METRES["mm"])
    hidden = np.asarray(np.isnan(position).any(axis=1))
    matrix = np.where(hidden[:, None], np.nan, part[:, MATRIX][:, BY_ROWS])
    error = np.where(hidden, np.nan, part[:, RESIDUAL] * METRES["mm"])
    return Body(PoseSignal(position, CONVERTERS["matrix"](matrix)), error)
