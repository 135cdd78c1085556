"""TRC tables of marker positions, as Motion Analysis defined them and OptiTrack, Qualisys and OpenSim write them.

Line 1 is `PathFileType 4 (X/Y/Z) name`, lines 2 and 3 name and give the rates, counts and the unit; line 4 is `Frame#`,
`Time` and a marker over every third column, line 5 `X1 Y1 Z1 X2 ...`; then an empty line, which some writers leave out.
Markers that software computed from others (virtual ones) stand in the samples like all others: named `V_...` by Cortex,
counted by neither line 3 nor line 5 by some, without a name by others.
"""

from __future__ import annotations

from pathlib import Path

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import Take, scale_of
from gpcorrect.logs.mocap.text import Export, read_export, seen_only

KEYS, VALUES, NAMES, _, DATA = range(1, 6)  # lines, counted from 0
FIRST = 2  # column of the first marker, after frame and time
VIRTUAL = "V_"  # how Cortex begins the name of a virtual marker


def read(path: Path, settings: ReadSettings) -> Take:
    """Read markers."""
    export = read_export(path)
    if len(export) <= DATA or not export.lines[NAMES].startswith("Frame#"):
        raise LogError("expected Frame#, Time and the names of the markers in line 4 of a TRC file.")
    header = dict(zip(export.cells(KEYS), export.cells(VALUES), strict=False))
    if "Units" not in header:
        raise LogError("line 2 of a TRC file must name Units.")
    lines = export.samples(DATA)
    width = max(len(export.cells(k)) for k in lines)
    names = _names(export)
    names += [f"{VIRTUAL}unnamed_{k}" for k in range(len(names) + 1, -(-(width - FIRST) // 3) + 1)]
    table = export.numbers(lines, range(1, FIRST + 3 * len(names)))
    points = table[:, 1:].reshape(len(table), len(names), 3) * scale_of(header["Units"])
    unseen = int((points == 0.0).all(axis=2).sum())
    remarks = [f"{unseen} positions at exactly 0, 0, 0 count as hidden."] if unseen else []
    virtual = [name for name in names if name.startswith(VIRTUAL)]
    remarks += [f"virtual markers are left out unless named: {', '.join(virtual)}."] if virtual else []
    if header.get("NumFrames", "") not in ("", str(len(table))):  # cut off, or cut out of a longer recording
        remarks.append(f"the header says {header['NumFrames']} frames, the file holds {len(table)}.")
    return Take(
        table[:, 0],
        markers={name: seen_only(points[:, k]) for k, name in enumerate(names)},
        others=virtual,
        remarks=remarks,
        tracker="TRC markers",
    )


def _names(export: Export) -> list[str]:
    """Markers, one over every third column; or one beside the other, where a writer left no empty cells between."""
    cells = export.cells(NAMES)[FIRST:]
    placed = list(cells[::3])
    names = placed if all(placed) and not any(c for k, c in enumerate(cells) if k % 3) else [c for c in cells if c]
    if not names or len(set(names)) < len(names):
        found = f"{len(names)} markers ({len(set(names))} different)"
        raise LogError(f"line 4 of the TRC file names {found}; expected a name of its own for each.")
    return names
