"""TRC tables of marker positions, as Motion Analysis defined them and OptiTrack, Qualisys and OpenSim write them.

Line 1 is `PathFileType 4 (X/Y/Z) name`, lines 2 and 3 name and give the rates, counts and the unit; line 4 is `Frame#`,
`Time` and a marker over every third column, line 5 `X1 Y1 Z1 X2 ...`; then an empty line, which some writers leave out.
"""

from __future__ import annotations

import re
from pathlib import Path

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import Take, log_of, scale_of
from gpcorrect.logs.mocap.text import Export, read_export, seen_only
from gpcorrect.types import CalibrationLog

__all__ = ["read"]

KEYS, VALUES, NAMES, AXES, DATA = range(1, 6)  # lines, counted from 0
FIRST = 2  # column of the first marker, after frame and time


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read the tool's pose from its markers.

    Parameters
    ----------
    path, settings
        See :func:`gpcorrect.logs.read_log`.

    Raises
    ------
    LogError
        The file is cut off, too large, of another layout, or in an unknown unit.
    """
    return log_of(_take(read_export(path)), settings.columns.mocap)


def _take(export: Export) -> Take:
    if len(export) <= DATA or not export.lines[NAMES].startswith("Frame#"):
        raise LogError("expected Frame#, Time and the names of the markers in line 4 of a TRC file.")
    header = dict(zip(export.cells(KEYS), export.cells(VALUES), strict=False))
    if "Units" not in header:
        raise LogError("line 2 of a TRC file must name Units.")
    names = _names(export)
    start = DATA + int(export.empty(DATA))
    stop = export.stop(start)
    table = export.numbers(start, stop, range(1, FIRST + 3 * len(names)))
    points = table[:, 1:].reshape(len(table), len(names), 3) * scale_of(header["Units"])
    seen = [seen_only(points[:, k]) for k in range(len(names))]
    unseen = sum(count for _, count in seen)
    remarks = [f"{unseen} positions at exactly 0, 0, 0 count as hidden."] if unseen else []
    if header.get("NumFrames", "") not in ("", str(len(table))):  # cut off, or cut out of a longer recording
        remarks.append(f"the header says {header['NumFrames']} frames, the file holds {len(table)}.")
    return Take(
        table[:, 0],
        markers={name: positions for name, (positions, _) in zip(names, seen, strict=True)},
        remarks=remarks,
        tracker="TRC markers",
    )


def _names(export: Export) -> list[str]:
    """Markers, one over every third column; what line 5 says must agree."""
    names = [cell for cell in export.cells(NAMES)[FIRST:] if cell]
    axes = [cell for cell in export.cells(AXES)[FIRST:] if re.fullmatch(r"[XYZ]\d+", cell)]
    if len(axes) != 3 * len(names) or len(set(names)) < len(names):
        raise LogError(
            f"line 4 of the TRC file names {len(names)} markers ({len(set(names))} different), line 5 has"
            f" {len(axes)} coordinates; expected three a marker."
        )
    return names
