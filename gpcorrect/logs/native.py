"""Names of the native log: the columns of each signal, and the signals that a table's names make up."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

from gpcorrect.logs.columns import ArrayColumns, ColumnMap, PoseColumns
from gpcorrect.types import CalibrationLog

__all__ = ["INDEX", "complete", "joint_names", "orientation_names", "position_names", "signal_of"]

INDEX = ("time", "trajectory", "session")


def position_names(signal: str) -> tuple[str, str, str]:
    """Columns of a pose signal's position."""
    return f"{signal}_x", f"{signal}_y", f"{signal}_z"


def orientation_names(signal: str) -> tuple[str, str, str, str]:
    """Columns of a pose signal's quaternion."""
    return f"{signal}_qw", f"{signal}_qx", f"{signal}_qy", f"{signal}_qz"


def joint_names(signal: str, dof: int) -> tuple[str, ...]:
    """Columns of a joint signal, counted from one."""
    return tuple(f"{signal}_{k}" for k in range(1, dof + 1))


def signal_of(column: str) -> str | None:
    """Name of the signal that a column belongs to by its name; None for a column outside the log format."""
    if column in (*INDEX, *CalibrationLog.SCALARS):
        return column
    signal, _, part = column.rpartition("_")
    if signal in CalibrationLog.POSES and part in ("x", "y", "z", "qw", "qx", "qy", "qz"):
        return signal
    if signal in CalibrationLog.JOINTS and re.fullmatch(r"[1-9]\d*", part):
        return signal
    return None


def complete(mapping: ColumnMap, names: Collection[str]) -> tuple[ColumnMap, list[str]]:
    """Fill a mapping with the signals that a table holds under their native names.

    Parameters
    ----------
    mapping : ColumnMap
        What the user said; it comes first.
    names : collection of str
        Columns of the table.

    Returns
    -------
    ColumnMap
        With every signal that can be read.
    list of str
        A remark on each signal that lacks columns.
    """
    update: dict[str, Any] = {name: name for name in INDEX if name in names}
    remarks: list[str] = []
    for signal in CalibrationLog.POSES:
        update[signal] = _pose(signal, names, remarks)
    for signal in CalibrationLog.JOINTS:
        update[signal] = _joints(signal, names, remarks)
    for signal in CalibrationLog.SCALARS:
        update[signal] = ArrayColumns(columns=(signal,)) if signal in names else None
    said = {name for name in update if getattr(mapping, name) is not None}
    found = {name: value for name, value in update.items() if name not in said}
    return mapping.model_copy(update=found), [r for r in remarks if r.split()[0] not in said]


def _pose(signal: str, names: Collection[str], remarks: list[str]) -> PoseColumns | None:
    position, orientation = position_names(signal), orientation_names(signal)
    missing = [n for n in position if n not in names]
    turned = [n for n in orientation if n not in names]
    if len(missing) == 3 and len(turned) == 4:
        return None
    if missing:
        remarks.append(f"{signal} is left out: it lacks {', '.join(missing)}.")
        return None
    if turned and len(turned) < 4:
        remarks.append(f"{signal} is read as positions only: its quaternion lacks {', '.join(turned)}.")
    return PoseColumns(position=position, quat_wxyz=None if turned else orientation)


def _joints(signal: str, names: Collection[str], remarks: list[str]) -> ArrayColumns | None:
    numbers = sorted(int(n.rpartition("_")[2]) for n in names if n != signal and signal_of(n) == signal)
    if not numbers:
        return None
    columns = joint_names(signal, numbers[-1])
    missing = [n for n in columns if n not in names]
    if missing:
        remarks.append(f"{signal} is left out: it lacks {', '.join(missing)}.")
        return None
    return ArrayColumns(columns=columns)
