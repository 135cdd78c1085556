"""CSV and text exports of Vicon Nexus and Tracker.

A file is made of sections, an empty line between them. A section is a title (`Objects`, `Segments`, `Trajectories`),
the rate in Hz, a line of names, each over the first of its columns, a line of axes that begins with `Frame,Sub Frame`,
a line of units, and the samples. Tracker puts `Global Angle` and, in newer versions, the kind of angle before the name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import MocapOptions, ReadSettings
from gpcorrect.logs.mocap.take import Body, Take, log_of, scale_of
from gpcorrect.logs.mocap.text import Export, read_export, seen_only
from gpcorrect.logs.orientation import CONVERTERS, quaternion_from_euler
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["TITLES", "read"]

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


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read the tool's pose: an object or segment, or markers.

    Parameters
    ----------
    path, settings
        See :func:`gpcorrect.logs.read_log`.

    Raises
    ------
    LogError
        The file is cut off, too large, in an unknown unit, or holds neither objects, segments nor trajectories.
    """
    export, options = read_export(path), settings.columns.mocap
    starts = [k for k in range(len(export)) if export.cells(k)[:1] and export.cells(k)[0] in TITLES]
    wanted = MARKERS if options.markers is not None else (*BODIES, *MARKERS)
    usable = sorted((k for k in starts if export.cells(k)[0] in wanted), key=lambda k: wanted.index(export.cells(k)[0]))
    if not usable:
        found = ", ".join(export.cells(k)[0] for k in starts)
        raise LogError(f"expected a section {', '.join(wanted)} in Vicon's export, found {found}.")
    return log_of(_take(_section(export, usable[0]), options), options)


def _section(export: Export, start: int) -> Section:
    if start + 5 > len(export) or export.cells(start + 3)[:1] != ("Frame",):
        raise LogError(f"expected rate, names, axes and units below {export.cells(start)[0]} (line {start + 1}).")
    try:
        rate = float(export.cells(start + 1)[0])
    except (IndexError, ValueError):
        raise LogError(f"expected the rate in Hz in line {start + 2}, got {export.lines[start + 1]!r}.") from None
    columns = _columns(export.cells(start + 2), export.cells(start + 3), export.cells(start + 4))
    table = export.numbers(start + 5, export.stop(start + 5), range(len(columns)))
    return Section(export.cells(start)[0], rate, columns, table)


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
