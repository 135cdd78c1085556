"""CSV and text exports of Vicon Nexus and Tracker.

A file is made of sections, an empty line between them. A section is a title (`Objects`, `Segments`, `Trajectories`),
the rate in Hz, a line of names, each over the first of its columns, a line of axes that begins with `Frame,Sub Frame`,
a line of units, and the samples. Title and units may be missing, and with them the rate. Tracker puts `Global Angle`
and, in newer versions, the kind of angle before the name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import MocapOptions, ReadSettings
from gpcorrect.logs.mocap.take import Body, Take, scale_of
from gpcorrect.logs.mocap.text import Export, read_export, seen_only
from gpcorrect.logs.orientation import CONVERTERS, quaternion_from_euler
from gpcorrect.types import FloatArray, PoseSignal

BODIES = ("Objects", "Segments")
MARKERS = ("Trajectories",)
TITLES = (*BODIES, *MARKERS, "Model Outputs", "Joints", "Devices", "Events", "Bones")
NAME = re.compile(r"Global Angle(?: \((?P<kind>[^)]*)\))? (?P<name>.*)")


@dataclass(frozen=True, eq=False)
class Column:
    """A column of a section: whose it is, what kind of angles it belongs to, its axis and unit."""

    name: str
    kind: str
    axis: str
    unit: str


@dataclass(frozen=True, eq=False)
class Section:
    """A section's samples."""

    title: str
    rate: float
    columns: Sequence[Column]
    table: FloatArray

    def items(self) -> dict[str, dict[str, int]]:
        """Columns of each body or marker by axis."""
        found: dict[str, dict[str, int]] = {}
        for k, column in enumerate(self.columns):
            if column.axis not in ("Frame", "Sub Frame"):
                found.setdefault(column.name, {})[column.axis] = k
        return found


def read(path: Path, settings: ReadSettings) -> Take:
    """Read objects or segments, or markers. See :data:`gpcorrect.logs.apart.Reader`."""
    export, options = read_export(path), settings.columns.mocap
    sections = [_heading(export, k) for k in range(len(export)) if _is_heading(export.cells(k))]
    wanted = MARKERS if options.markers is not None else (*BODIES, *MARKERS)
    usable = sorted((h for h in sections if h.title in wanted), key=lambda h: wanted.index(h.title))
    if not usable:
        found = ", ".join(h.title for h in sections)
        raise LogError(f"expected a section {', '.join(wanted)} in Vicon's export, found {found}.")
    return _take(_section(export, usable[0], settings.columns.rate), options)


def _is_heading(cells: Sequence[str]) -> bool:
    """Whether a line is the one of axes, from which a section is known whether it has a title or not."""
    return len(cells) > 1 and cells[0] == "Frame" and cells[1] in ("Sub Frame", "SubFrame")


@dataclass(frozen=True)
class Heading:
    """Where a section's line of axes is, and its title: by what the axes say where the export has none."""

    line: int
    title: str


def _heading(export: Export, line: int) -> Heading:
    above = [export.cells(k)[0] for k in range(max(line - 3, 0), line) if export.cells(k)]
    axes = export.cells(line)
    guessed = BODIES[0] if "TX" in axes else MARKERS[0] if "X" in axes else "Devices"
    return Heading(line, next((title for title in above if title in TITLES), guessed))


def _section(export: Export, heading: Heading, stated: float | None) -> Section:
    line = heading.line
    if line < 1 or line + 1 >= len(export):
        raise LogError(f"expected rate, names, axes, units and samples around line {line + 1}.")
    cell = next(iter(export.cells(line - 2)), "") if line > 1 else ""
    try:
        rate = stated or float(cell)
    except ValueError:
        hint = "Say rate = 100.0 in a mapping file."
        raise LogError(f"expected the rate in Hz in line {line - 1}, got {cell!r}.", hint=hint) from None
    units = export.cells(line + 1)
    start = line + 1 if units and units[0] else line + 2  # some exports have no line of units
    columns = _columns(export.cells(line - 1), export.cells(line), units if start > line + 1 else ())
    table = export.numbers(start, export.stop(start), range(len(columns)))
    return Section(heading.title, rate, columns, table)


def _columns(names: Sequence[str], axes: Sequence[str], units: Sequence[str]) -> list[Column]:
    """Columns with the names that stand over the first of each group, or over all of them."""
    columns, name, kind = [], "", ""
    for k, axis in enumerate(axes):
        above = names[k] if k < len(names) else ""
        if above:
            match = NAME.fullmatch(above)
            name, kind = (match["name"], match["kind"] or "") if match else (above, "")
            subject, _, segment = name.partition(":")
            name = subject if subject == segment else name
        columns.append(Column(name, kind, axis, units[k] if k < len(units) else ""))
    return columns


def _take(section: Section, options: MocapOptions) -> Take:
    time = section.table[:, 0] / section.rate
    solved = section.title in BODIES
    needed = {"TX", "TY", "TZ"} if solved else {"X", "Y", "Z"}
    items = {name: axes for name, axes in section.items().items() if needed <= set(axes)}
    remarks: list[str] = []
    if not solved:
        markers = {name: _position(section, axes, "", remarks) for name, axes in items.items()}
        others = [name for name in markers if name.startswith("*")]  # Nexus calls what it did not label *12
        return Take(time, markers=markers, others=others, remarks=_once(remarks), tracker="Vicon")
    bodies = {name: _body(section, name, axes, options, remarks) for name, axes in items.items()}
    return Take(time, bodies=bodies, remarks=_once(remarks), tracker="Vicon")


def _once(remarks: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(remarks))


def _position(section: Section, axes: Mapping[str, int], prefix: str, remarks: list[str]) -> FloatArray:
    places = [axes[f"{prefix}{axis}"] for axis in "XYZ"]
    unit = section.columns[places[0]].unit
    if not unit:
        remarks.append("the export states no unit of length; millimetres were assumed, as usual with Vicon.")
    return seen_only(section.table[:, places] * scale_of(unit or "mm"))[0]


def _body(section: Section, name: str, axes: Mapping[str, int], options: MocapOptions, remarks: list[str]) -> Body:
    position = _position(section, axes, "T", remarks)
    turned = [axes[axis] for axis in ("RX", "RY", "RZ", "RW") if axis in axes]
    quaternion = None
    if len(turned) >= 3:
        quaternion = _quaternion(section.table[:, turned], section.columns[turned[0]], options, remarks)
        quaternion[~np.asarray(np.isfinite(position).all(axis=1))] = np.nan
    return Body(PoseSignal(position, quaternion))


def _quaternion(values: FloatArray, column: Column, options: MocapOptions, remarks: list[str]) -> FloatArray:
    """Quaternions of four columns xyzw, or of three: a rotation vector unless the header or the user says Euler."""
    if values.shape[1] == 4:
        return CONVERTERS["quat_xyzw"](values)
    angles = np.deg2rad(values) if column.unit.lower().startswith("deg") else values
    rotation = options.rotation or ("XYZ" if "euler" in column.kind.lower() else "")
    if not rotation and "helical" not in column.kind.lower():
        remarks.append(
            "three angles were taken for rotation vectors (helical), as Vicon writes them by default;"
            ' if they are Euler angles, say so: [mocap] rotation = "XYZ".'
        )
    if rotation in ("", "rotvec"):
        return CONVERTERS["rotvec"](angles)
    return quaternion_from_euler(angles, rotation)
