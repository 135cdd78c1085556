"""CSV recordings of NDI trackers (Polaris, Vega, Aurora): Track, ToolBox, the sample programs of the Combined API.

A line holds the number of tools, then for each tool its label, frame number, where exported its time, face, state, the
quaternion, the position in mm and the error of the fit in mm; then the number of its markers and four cells for each.
A tool that is not seen has no numbers, or some of 1e28.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import METRES, Body, Take
from gpcorrect.logs.mocap.text import read_export
from gpcorrect.logs.orientation import unit_quaternions
from gpcorrect.types import FloatArray, PoseSignal

MARKS = (b"Tools,Port", b"#Tools,ToolInfo", b"ToolCount,ToolInfo")
POSE = ("Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error")
LARGEST = 1e20  # NDI writes -3.697314E28 for what it does not see
FRAME_RATE = 60.0  # Hz at which Polaris and Vega count frames, whatever their rate of measuring
PER_MARKER = 4  # cells: state and position


def read(path: Path, settings: ReadSettings) -> Take:
    """Read the poses of tools."""
    export = read_export(path, ",")
    names = _layout(export.cells(0))
    rows = [
        (line, _tools(cells, names, line))
        for line, cells in enumerate(csv.reader(export.lines[1:]), start=2)
        if any(cell.strip() for cell in cells)
    ]
    if not rows:
        raise LogError("the file has a header but no samples.")
    first = [label for label, _ in rows[0][1]]
    for line, tools in rows:
        if (here := [label for label, _ in tools]) != first:
            raise LogError(f"line {line} holds the tools {', '.join(here)}, line {rows[0][0]} {', '.join(first)}.")
    labels = [_name(label, k) for k, label in enumerate(first)]
    if len(set(labels)) < len(labels):
        raise LogError(f"two tools have one name: {', '.join(labels)}.", hint="Give each its own in the export.")
    table = np.array([[values for _, values in tools] for _, tools in rows])  # (n, tools, columns)
    time, remarks = _time(table[:, 0], names, settings.columns.rate)
    place = [names.index(name) for name in POSE]
    bodies = {label: _body(table[:, k][:, place]) for k, label in enumerate(labels)}
    return Take(time, bodies=bodies, remarks=remarks, tracker="NDI")


def _layout(header: Sequence[str]) -> list[str]:
    """Columns of a tool after its label, by name."""
    names = [name.strip() for name in header[2:]]
    if "Error" not in names or not set(POSE) <= set(names[: names.index("Error") + 1]):
        hint = "Export rotations as quaternions."
        raise LogError(f"expected the columns {', '.join(POSE)} for each tool in NDI's CSV.", hint=hint)
    stop = names.index("Error") + 1
    return names[: stop + 1] if "".join(names[stop : stop + 1]).endswith("Markers") else names[:stop]


def _tools(cells: Sequence[str], names: Sequence[str], line: int) -> list[tuple[str, list[float]]]:
    """Label and numbers of each tool in a line."""
    tools, at = [], 1
    while at + len(names) < len(cells) + 1 and cells[at].strip():
        values = [_number(cell) for cell in cells[at + 1 : at + 1 + len(names)]]
        if len(values) < len(names):
            raise LogError(f"line {line} ends inside a tool.")
        tools.append((cells[at], values))
        at += 1 + len(names)
        if names[-1].endswith("Markers"):
            at += PER_MARKER * max(int(values[-1]), 0) if math.isfinite(values[-1]) else 0
    if str(len(tools)) != cells[0].strip():
        raise LogError(f"line {line} announces {cells[0]} tools and holds {len(tools)}.")
    return tools


def _number(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        return math.nan
    return value if abs(value) < LARGEST else math.nan


def _name(label: str, k: int) -> str:
    """Return a tool's name without its port and serial number, where it has one."""
    match = re.fullmatch(r"(?:Port\s*\w+\s*:)?\s*(.*?)\s*(?:s/n:.*)?", label.strip())
    return (match and match[1]) or label.strip() or f"tool {k + 1}"


def _time(table: FloatArray, names: Sequence[str], rate: float | None) -> tuple[FloatArray, list[str]]:
    """Seconds: a column or two of the file, else the frame's number."""
    column = {name: table[:, k] for k, name in enumerate(names)}
    if "timespec_s" in column and "timespec_ns" in column:
        return column["timespec_s"] + 1e-9 * column["timespec_ns"], []
    stamped = next((values for name, values in column.items() if name.startswith("Time")), None)
    if stamped is not None:
        return stamped, []
    frames = next((values for name, values in column.items() if name.startswith("Frame")), None)
    if frames is None:
        raise LogError("expected a column Frame or Time for each tool in NDI's CSV.")
    said = (
        [] if rate else ["frames were counted at 60 Hz, as Polaris and Vega do; say rate in a mapping file otherwise."]
    )
    return frames / (rate or FRAME_RATE), said


def _body(values: FloatArray) -> Body:
    position = values[:, 4:7] * METRES["mm"]
    hidden = np.asarray(np.isnan(position).any(axis=1))
    quaternion = unit_quaternions(np.where(hidden[:, None], np.nan, values[:, :4]))
    return Body(PoseSignal(position, quaternion), np.where(hidden, np.nan, values[:, 7] * METRES["mm"]))
