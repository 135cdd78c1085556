"""CSV exports of OptiTrack Motive, format versions 1.2 to 1.25.

Line 1 holds pairs of keys and values (`Format Version`, `Rotation Type`, `Length Units`, ...). Above each column stand
its `Type`, `Name`, `ID`, in newer versions `Parent`, a line of quantities (`Rotation`, `Position`, `Mean Marker
Error`), and the line of axes that begins with `Frame`. Up to 1.21 the labels of these lines are left out and the time
is `Time`, later `Time (Seconds)`. Euler angles turn about the body's own axes in the order that `Rotation Type` names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import EulerOrder, ReadSettings
from gpcorrect.logs.mocap.take import Body, Take, scale_of
from gpcorrect.logs.mocap.text import Export, read_export, seen_only
from gpcorrect.logs.orientation import quaternion_from_euler, unit_quaternions
from gpcorrect.types import FloatArray, PoseSignal

TYPES = ("Rigid Body", "Marker", "Rigid Body Marker", "Bone", "Bone Marker")
BODY, MARKER = "Rigid Body", "Marker"
ORDERS = get_args(EulerOrder)


Columns = Mapping[str, Mapping[str, int]]
"""Of a body or marker: the columns of its Rotation, Position and Error, by axis."""


def read(path: Path, settings: ReadSettings) -> Take:
    """Read rigid bodies and markers."""
    export = read_export(path)
    cells = export.cells(0)
    header = dict(zip(cells[::2], cells[1::2], strict=False))
    heading = next((k for k in range(1, len(export)) if export.cells(k)[:1] == ("Frame",)), None)
    if heading is None or "Length Units" not in header:
        raise LogError("expected Length Units in line 1 of Motive's CSV, and a line that begins with Frame.")
    items = _items(export, heading)
    axes = export.cells(heading)
    clock = next((k for k, cell in enumerate(axes) if cell == "Time" or cell.startswith("Time (")), None)
    if clock is None:
        raise LogError("expected a column Time or Time (Seconds) in Motive's CSV.")
    width = max(len(export.cells(k)) for k in range(1, heading + 1))
    text = {k for k, cell in enumerate(axes) if cell == "TimeCode"}
    columns = [k for k in range(1, width) if k not in text]
    table = export.numbers(export.samples(heading + 1), columns)
    values = {column: table[:, place] for place, column in enumerate(columns)}
    return _taken(header, items, values, values[clock])


def _items(export: Export, heading: int) -> dict[tuple[str, str], Columns]:
    """Columns of each item, by its type and name, in the order of the file."""
    lines = [export.cells(k) for k in range(1, heading) if export.cells(k)]
    kinds, names = (_labelled(lines, label) for label in ("Type", "Name"))
    quantities, axes = lines[-1] if lines else (), export.cells(heading)
    if not (kinds and names) or "Position" not in quantities:
        raise LogError("the header of Motive's CSV lacks the lines of types, names and quantities.")
    width = max(len(kinds), len(names), len(quantities))
    table = [row + ("",) * (width - len(row)) for row in (kinds, names, quantities, axes)]
    found: dict[tuple[str, str], dict[str, dict[str, int]]] = {}
    for k, (kind, name, quantity, axis) in enumerate(zip(*table, strict=False)):
        if k >= 2 and kind:
            what = "Error" if "Error" in quantity or "Error" in axis else quantity
            parts = found.setdefault((kind, name), {}).setdefault(what, {})
            if axis in parts and kind == BODY:
                raise LogError(f"two rigid bodies are called {name}.", hint="Give each its own name in the export.")
            parts[axis] = k
    return {key: {"Rotation": {}, "Position": {}, "Error": {}, **parts} for key, parts in found.items()}


def _labelled(lines: Sequence[tuple[str, ...]], label: str) -> tuple[str, ...]:
    """Return the line with this label; without labels, types are known by their words and names come below them."""
    for line in lines:
        if label in line[:2]:
            return line
    for k, line in enumerate(lines[:-1]):
        if any(cell in TYPES for cell in line):
            return line if label == "Type" else lines[k + 1]
    return ()


def _taken(
    header: Mapping[str, str],
    items: Mapping[tuple[str, str], Columns],
    values: Mapping[int, FloatArray],
    time: FloatArray,
) -> Take:
    scale, rotation = scale_of(header["Length Units"]), header.get("Rotation Type", "Quaternion")
    bodies = {n: _body(n, columns, values, rotation, scale) for (kind, n), columns in items.items() if kind == BODY}
    markers, others = {}, []
    for kind, name in sorted(items, key=lambda i: i[0] == MARKER):  # one that was seen counts before an expected one
        position = items[kind, name]["Position"]
        if kind.endswith(MARKER) and set("XYZ") <= set(position):
            markers[name] = seen_only(_stack(values, position, "XYZ") * scale)
            if kind != MARKER or name.startswith("Unlabeled"):
                others.append(name)
    space = header.get("Coordinate Space", "Global")
    remarks = [] if space == "Global" else [f"the coordinate space is {space}: bodies may be relative to others."]
    seen = {name for kind, name in items if kind == MARKER and not name.startswith("Unlabeled")}
    return Take(time, bodies, markers, [n for n in others if n not in seen], remarks, "OptiTrack Motive")


def _body(name: str, columns: Columns, values: Mapping[int, FloatArray], rotation: str, scale: float) -> Body:
    if not set("XYZ") <= set(columns["Position"]):
        raise LogError(f"the body {name} has no position.", hint="Export rigid bodies with their positions.")
    position = seen_only(_stack(values, columns["Position"], "XYZ") * scale)
    quaternion = None
    if columns["Rotation"] and rotation == "Quaternion":
        quaternion = unit_quaternions(_stack(values, columns["Rotation"], "WXYZ"))
    elif columns["Rotation"]:
        if rotation not in ORDERS:
            raise LogError(f"expected Rotation Type Quaternion or one of {', '.join(ORDERS)}, got {rotation!r}.")
        quaternion = quaternion_from_euler(np.deg2rad(_stack(values, columns["Rotation"], "XYZ")), rotation)
    error = next((values[k] * scale for k in columns["Error"].values()), None)
    return Body(PoseSignal(position, quaternion), error)


def _stack(values: Mapping[int, FloatArray], columns: Mapping[str, int], axes: str) -> FloatArray:
    missing = [axis for axis in axes if axis not in columns]
    if missing:
        raise LogError(f"Motive's CSV lacks the column {missing[0]} of a rotation.")
    return np.stack([values[columns[axis]] for axis in axes], axis=1)
