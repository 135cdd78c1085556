"""Put a log's tracker on the robot's clock: what it saw, at the time at which the robot did it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gpcorrect.errors import DegenerateError, LogError
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.sync.motion import clock_runs
from gpcorrect.logs.sync.offset import TimeOffset
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["align"]


def align(
    log: CalibrationLog,
    offset: TimeOffset | float,
    *,
    signals: Sequence[str] = ("tracker_cp",),
    max_gap: float | None = None,
) -> CalibrationLog:
    """Return the log with signal(t + d) in place of signal(t), for the signals of the other clock.

    Positions and joints are interpolated linearly, rotations along the shortest arc, as far as
    the clock ran on and never across a gap.

    Parameters
    ----------
    log : CalibrationLog
        Not changed.
    offset : TimeOffset or float
        Seconds d by which the stamps of these signals run ahead; an estimate brings its drift along.
    signals : sequence of str
        Those that the other clock stamped; add external_jp where its joints come from the same tracker.
    max_gap : float, optional
        Longest time between two samples to interpolate across, s; five median steps by default.

    Returns
    -------
    CalibrationLog
        Same rows; NaN where no sample of the other clock is near enough in time, as at one end of the
        recording.

    Raises
    ------
    DegenerateError
        The estimate says that the offset is not observable.
    LogError
        The log has no such signal, or no clock.
    """
    if log.static:
        raise LogError("static poses have no clock to shift.", hint="Leave the time offset out.", path=log.name)
    shift = _shift(offset, log.time)
    for name in signals:
        if name not in (*log.POSES, *log.JOINTS) or name not in log.signals:
            raise LogError(f"cannot align {name}: the log has {', '.join(log.signals)}.", hint="Name a motion signal.")
    moved: dict[str, Any] = {name: _resampled(log, name, log.time + shift, max_gap) for name in signals}
    return replace(log, **moved)


def _shift(offset: TimeOffset | float, time: FloatArray) -> FloatArray:
    if not isinstance(offset, TimeOffset):
        return np.full(len(time), float(offset))
    if not offset.observable:
        raise DegenerateError(
            f"the time offset is not observable: {offset.reason}",
            hint="Give the offset in seconds if it is known from elsewhere, 0 if the clocks agree.",
        )
    return offset.at(time)


def _resampled(log: CalibrationLog, name: str, at: FloatArray, max_gap: float | None) -> PoseSignal | FloatArray:
    values: PoseSignal | FloatArray = getattr(log, name)
    columns = _table(values)
    moved = np.full(columns.shape, np.nan)
    for rows in clock_runs(log):
        piece = interpolate(Stream(name, log.time[rows], values[rows]), at[rows], max_gap)
        moved[rows] = _table(piece)
    if not isinstance(values, PoseSignal):
        return moved
    return PoseSignal(moved[:, :3], None if values.quaternion is None else moved[:, 3:])


def _table(values: PoseSignal | FloatArray) -> FloatArray:
    if not isinstance(values, PoseSignal):
        return values
    return values.position if values.quaternion is None else np.hstack([values.position, values.quaternion])
