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
class Section:
    """A section's samples."""

    time: FloatArray
    table: FloatArray
    items: Mapping[str, Mapping[str, int]]  # columns of each body or marker by axis
    kinds: Sequence[str]  # of angles, of each column
    units: Mapping[int, str]  # of each column, where the export states them


def read(path: Path, settings: ReadSettings) -> Take:
    """Read objects or segments, or markers."""
    export, options = read_export(path), settings.columns.mocap
    # The line of axes, from which a section is known whether it has a title or not.
    lines = [k for k in range(len(export)) if export.cells(k)[:2] in (("Frame", "Sub Frame"), ("Frame", "SubFrame"))]
    titles = [_title(export, line) for line in lines]
    wanted = MARKERS if options.markers is not None else (*BODIES, *MARKERS)
    title = next((title for title in wanted if title in titles), None)
    if title is None:
        raise LogError(f"expected a section {', '.join(wanted)} in Vicon's export, found {', '.join(titles)}.")
    section = _section(export, lines[titles.index(title)], settings.columns.rate)
    remarks: dict[str, None] = {}  # each once
    if title in BODIES:
        items = {name: axes for name, axes in section.items.items() if {"TX", "TY", "TZ"} <= set(axes)}
        bodies = {name: _body(section, axes, options, remarks) for name, axes in items.items()}
        return Take(section.time, bodies=bodies, remarks=[*remarks], tracker="Vicon")
    items = {name: axes for name, axes in section.items.items() if {"X", "Y", "Z"} <= set(axes)}
    markers = {name: _position(section, axes, "", remarks) for name, axes in items.items()}
    others = [name for name in markers if name.startswith("*")]  # Nexus calls what it did not label *12
    return Take(section.time, markers=markers, others=others, remarks=[*remarks], tracker="Vicon")


def _title(export: Export, line: int) -> str:
    """Title of the section whose axes are in this line: by what the axes say where the export has none."""
    above = [export.cells(k)[0] for k in range(max(line - 3, 0), line) if export.cells(k)]
    axes = export.cells(line)
    guessed = BODIES[0] if "TX" in axes else MARKERS[0] if "X" in axes else "Devices"
    return next((title for title in above if title in TITLES), guessed)


def _section(export: Export, line: int, stated: float | None) -> Section:
    if line < 1 or line + 1 >= len(export):
        raise LogError(f"expected rate, names, axes, units and samples around line {line + 1}.")
    cell = next(iter(export.cells(line - 2)), "") if line > 1 else ""
    try:
        rate = stated or float(cell)
    except ValueError:
        rate = 0.0
    if not 0.0 < rate < np.inf:
        hint = "Say rate = 100.0 in a mapping file."
        raise LogError(f"expected the rate in Hz in line {line - 1}, got {cell!r}.", hint=hint)
    units, axes = export.cells(line + 1), export.cells(line)
    start = line + 1 if units and units[0] else line + 2  # some exports have no line of units
    items, kinds = _items(export.cells(line - 1), axes)
    # Samples begin with a frame's number; the only cell of a line is a title or a rate.
    cells = ((k, export.cells(k)) for k in range(start, len(export)))
    beyond = (k for k, found in cells if found and not (len(found) > 1 and found[0].isdigit()))
    table = export.numbers(export.samples(start, next(beyond, None)), range(len(axes)))
    return Section(table[:, 0] / rate, table, items, kinds, dict(enumerate(units)) if start > line + 1 else {})


def _items(names: Sequence[str], axes: Sequence[str]) -> tuple[dict[str, dict[str, int]], list[str]]:
    """Columns of each name, which stands over the first of its group or over all, by axis; and all kinds of angles."""
    items, kinds, name, kind = dict[str, dict[str, int]](), list[str](), "", ""
    for k, axis in enumerate(axes):
        above = names[k] if k < len(names) else ""
        if above:
            match = NAME.fullmatch(above)
            name, kind = (match["name"], match["kind"] or "") if match else (above, "")
            subject, _, segment = name.partition(":")
            name = subject if subject == segment else name
        if axis in items.setdefault(name, {}) and axis in ("TX", "X") and not name.startswith("*"):
            raise LogError(f"two items are called {name!r}.", hint="Give each its own name in the export.")
        items[name][axis] = k
        kinds.append(kind)
    return items, kinds


def _position(section: Section, axes: Mapping[str, int], prefix: str, remarks: dict[str, None]) -> FloatArray:
    places = [axes[f"{prefix}{axis}"] for axis in "XYZ"]
    unit = section.units.get(places[0])
    if not unit:
        remarks["the export states no unit of length; millimetres were assumed, as usual with Vicon."] = None
    return seen_only(section.table[:, places] * scale_of(unit or "mm"))


def _body(section: Section, axes: Mapping[str, int], options: MocapOptions, remarks: dict[str, None]) -> Body:
    position = _position(section, axes, "T", remarks)
    turned = [axes[axis] for axis in ("RX", "RY", "RZ", "RW") if axis in axes]
    quaternion = None
    if len(turned) >= 3:
        unit, kind = section.units.get(turned[0], "").lower(), section.kinds[turned[0]].lower()
        quaternion = _quaternion(section.table[:, turned], unit, kind, options.rotation, remarks)
        quaternion[~np.asarray(np.isfinite(position).all(axis=1))] = np.nan
    return Body(PoseSignal(position, quaternion))


def _quaternion(values: FloatArray, unit: str, kind: str, stated: str | None, remarks: dict[str, None]) -> FloatArray:
    """Quaternions of four columns xyzw, or of three: a rotation vector unless the header or the user says Euler."""
    if values.shape[1] == 4:
        return CONVERTERS["quat_xyzw"](values)
    angles = np.deg2rad(values) if unit.startswith("deg") else values
    rotation = stated or ("XYZ" if "euler" in kind else "")
    if not rotation and "helical" not in kind:
        remarks[
            "three angles were taken for rotation vectors (helical), as Vicon writes them by default;"
            ' if they are Euler angles, say so: [mocap] rotation = "XYZ".'
        ] = None
    if rotation in ("", "rotvec"):
        return CONVERTERS["rotvec"](angles)
    return quaternion_from_euler(angles, rotation)
