"""From a table of numbers to a log: what every tabular format shares."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ArrayColumns, Column, ColumnMap, PoseColumns
from gpcorrect.logs.order import Disorder, check_order
from gpcorrect.logs.orientation import quaternions_of
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal

INDEX = ("time", "trajectory", "session")
POSE_PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz")
CLOCK = r"time|stamp|clock|^t$|^sec|second"  # a column of such a name may be the time of a table that names none
# A remark on tables of single poses.
STATIC = "there is no time: static poses without a clock, each row a motion of its own."
NAMED = 3  # missing columns of a joint signal that a remark names
LARGEST_WHOLE = 2.0**53  # beyond it not every whole number is a float


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of numbers, however they were stored."""

    columns: Mapping[str, FloatArray]  # (n,) each, in the order of the file
    locate: Callable[[int], str]  # names a row for messages, such as "line 12"
    left_out: tuple[str, ...] = ()  # columns of the file that hold no numbers

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def name(self, column: Column) -> str:
        """Name of a column.

        Parameters
        ----------
        column : str or int, by name or number
        """
        names = list(self.columns)
        if isinstance(column, int) and column < len(names):
            return names[column]
        if column in self.columns:
            return str(column)
        if isinstance(column, int):
            raise LogError(f"there is no column {column}: the table has {len(names)}, counted from 0.")
        near = get_close_matches(column, names, n=1)
        came = f"Did you mean {near[0]}?" if near else f"Columns here: {', '.join(names)}."
        hint = f"{came} A mapping file can say which column is which."
        raise LogError(f"there is no column {column!r} of numbers.", hint=hint)

    def stack(self, columns: tuple[Column, ...]) -> FloatArray:
        """Columns `(n, k)` side by side.

        Parameters
        ----------
        columns : tuple of str or int, by name or number
        """
        return np.stack([self.columns[self.name(c)] for c in columns], axis=1)


def log_from_table(table: Table, mapping: ColumnMap, disorder: Disorder) -> CalibrationLog:
    """Build a log from the columns that the mapping names, and from those with native names.

    Parameters
    ----------
    table : Table
    mapping : ColumnMap
    disorder : {"refuse", "drop", "keep"}, what to do about time that does not increase
    """
    found, remarks = complete(mapping, (*table.columns, *table.left_out))
    if not len(table):
        raise LogError("the table has column names but no samples.")
    words = [name for name in table.left_out if name in found.used]
    if words:
        raise LogError(f"column {words[0]} must hold a number for every sample.", hint="Or give it another name.")
    clockless = not any(re.search(CLOCK, n, re.IGNORECASE) for n in (*table.columns, *table.left_out))
    motions = any(getattr(found, name) is not None for name in (*CalibrationLog.POSES, *CalibrationLog.JOINTS))
    static = found.time is None and found.rate is None and clockless and motions
    count = np.arange(len(table))
    if static:
        found = found.model_copy(update={"trajectory": None})
        remarks.append(STATIC)
        time = count.astype(np.float64)
    elif found.rate is not None:
        time = count / found.rate + found.time_offset
    else:
        scaled = table.stack(found.times or ("time",)) * np.asarray(found.time_scale)
        time = scaled.sum(axis=1) + found.time_offset
    trajectory = count if static else _integers(table, "trajectory", found.trajectory)
    session = _integers(table, "session", found.session)
    time, keep, order_remarks = check_order(time, trajectory, disorder, table.locate)
    signals: dict[str, Any] = {}
    for name in (*CalibrationLog.POSES, *CalibrationLog.JOINTS, *CalibrationLog.SCALARS):
        signals[name], remark = _signal(table, name, getattr(found, name))
        remarks += remark
    extra, left_out = _extra(table, found)
    remarks = [*remarks, *order_remarks, *left_out]
    log = CalibrationLog(time, trajectory, session, **signals, extra=extra, remarks=tuple(remarks), static=static)
    return log if keep.all() else log.select(keep)


def _signal(table: Table, name: str, columns: PoseColumns | ArrayColumns | None) -> tuple[Any, list[str]]:
    """Values of a signal, None when it is absent, and remarks on them."""
    if columns is None:
        return None, []
    if isinstance(columns, ArrayColumns):
        values = table.stack(columns.columns) * np.asarray(columns.scale) + np.asarray(columns.offset)
        return values[:, 0] if name in CalibrationLog.SCALARS else values, []
    position = table.stack(columns.position or ()) * columns.position_scale
    if columns.orientation is None:
        return PoseSignal(position), []
    form, names = columns.orientation
    quaternion, remarks = quaternions_of(name, form, table.stack(names))
    return PoseSignal(position, quaternion), remarks


def _integers(table: Table, name: str, column: Column | None) -> IntArray:
    """Trajectory or session numbers; all zero where there is no such column."""
    if column is None:
        return np.zeros(len(table), dtype=np.int64)
    values = table.columns[table.name(column)]
    whole = (np.abs(values) < LARGEST_WHOLE) & (values == np.round(values))
    wrong = np.flatnonzero(~whole)
    if wrong.size:
        row = int(wrong[0])
        came = "nothing" if np.isnan(values[row]) else f"{values[row]:g}"
        raise LogError(f"{name} must be a whole number for every sample, got {came} at {table.locate(row)}.")
    return values.astype(np.int64)


def _extra(table: Table, found: ColumnMap) -> tuple[dict[str, FloatArray], list[str]]:
    """Columns that became no signal, but none that a written log would take for part of one."""
    used = {table.name(column) for column in found.used}
    rest = {name: values for name, values in table.columns.items() if name not in used}
    present = [name for name, value in found if value is not None]
    clash = [name for name in rest if _signal_of(name) in present]
    remarks = [f"columns without numbers are left out: {', '.join(table.left_out)}."] if table.left_out else []
    if clash:
        remarks.append(f"columns left out, because the mapping gives these signals otherwise: {', '.join(clash)}.")
    return {name: values for name, values in rest.items() if name not in clash}, remarks


def pose_names(signal: str) -> tuple[str, ...]:
    """Columns of a pose signal: three of its position, then four of its quaternion.

    Parameters
    ----------
    signal : str, such as "tracker_cp"
    """
    return tuple(f"{signal}_{part}" for part in POSE_PARTS)


def _joint_names(signal: str, dof: int) -> tuple[str, ...]:
    """Columns of a joint signal, counted from one."""
    return tuple(f"{signal}_{k}" for k in range(1, dof + 1))


def signal_columns(log: CalibrationLog) -> dict[str, FloatArray]:
    """Columns of a log's signals under their native names.

    Parameters
    ----------
    log : CalibrationLog
    """
    columns: dict[str, FloatArray] = {}
    for name in log.signals:
        values = getattr(log, name)
        if isinstance(values, PoseSignal):
            columns |= zip(pose_names(name), values.table.T, strict=False)
        elif values.ndim == 1:
            columns[name] = values
        else:
            columns |= zip(_joint_names(name, values.shape[1]), values.T, strict=True)
    return columns


def _signal_of(column: str) -> str | None:
    """Name of the signal that a column belongs to by its name; None for a column outside the log format."""
    if column in (*INDEX, *CalibrationLog.SCALARS):
        return column
    signal, _, part = column.rpartition("_")
    if signal in CalibrationLog.POSES and part in POSE_PARTS:
        return signal
    if signal in CalibrationLog.JOINTS and re.fullmatch(r"\d+", part):
        return signal
    return None


def complete(mapping: ColumnMap, names: Collection[str]) -> tuple[ColumnMap, list[str]]:
    """Fill a mapping with the signals that a table holds under their native names; remark on each that lacks columns.

    Parameters
    ----------
    mapping : ColumnMap, by the user; it comes first
    names : collection of str
    """
    found: dict[str, Any] = {}
    remarks: list[str] = []
    for name in (*INDEX, *CalibrationLog.POSES, *CalibrationLog.JOINTS, *CalibrationLog.SCALARS):
        given = name == "time" and mapping.rate is not None
        if given or (getattr(mapping, name) is not None and name not in mapping.scales):
            continue
        if name in CalibrationLog.POSES:
            found[name] = _pose(name, names, remarks)
        elif name in CalibrationLog.JOINTS:
            found[name] = _joints(name, names, remarks)
        elif name in names:
            found[name] = name if name in INDEX else ArrayColumns(columns=(name,))
    return mapping.model_copy(update=found), remarks


def _pose(signal: str, names: Collection[str], remarks: list[str]) -> PoseColumns | None:
    x, y, z, qw, qx, qy, qz = columns = pose_names(signal)
    missing = [n for n in columns[:3] if n not in names]
    turned = [n for n in columns[3:] if n not in names]
    if len(missing) == 3 and len(turned) == 4:
        return None
    if missing:
        remarks.append(f"{signal} is left out: it lacks {', '.join(missing)}.")
        return None
    if turned and len(turned) < 4:
        remarks.append(f"{signal} is read as positions only: its quaternion lacks {', '.join(turned)}.")
    return PoseColumns(position=(x, y, z), quat_wxyz=None if turned else (qw, qx, qy, qz))


def _joints(signal: str, names: Collection[str], remarks: list[str]) -> ArrayColumns | None:
    numbered = {n: int(n.rpartition("_")[2]) for n in names if _signal_of(n) == signal}
    if not numbered:
        return None
    columns = _joint_names(signal, min(max(numbered.values()), len(numbered) + NAMED))  # a name may end in any number
    missing = [n for n in columns if n not in names]
    odd = [n for n in numbered if n not in columns]
    if missing or odd:
        why = f"it lacks {', '.join(missing)}" if missing else f"its joints are counted from 1, and there is {odd[0]}"
        remarks.append(f"{signal} is left out: {why}.")
        return None
    return ArrayColumns(columns=columns)
