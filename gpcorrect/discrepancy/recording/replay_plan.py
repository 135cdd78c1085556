"""What the log commanded, laid out for the closed loop."""

from __future__ import annotations

import numpy as np

from gpcorrect.discrepancy.recording.channels import joint_columns
from gpcorrect.discrepancy.recording.layout import Layout
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

__all__ = ["RUN_OUT", "commanded_plan"]

LAST = 5  # rows whose parabola a motion goes on along
RUN_OUT = 40  # rows that a motion goes on for behind a piece's or a recording's end


def commanded_plan(
    log: CalibrationLog, joints: tuple[int, ...], layout: Layout, motion: Motion, payload: FloatArray
) -> Plan:
    """Plan of the commands that a log holds, a run for each column of its layout.

    Parameters
    ----------
    log : CalibrationLog
        With setpoint_jp on an even clock.
    joints : tuple of int
        Numbers of the columns.
    layout : Layout
        Where the rows stand.
    motion : Motion
        Of the motors, for the clock and the sessions.
    payload : (N,) array
        kg at the tip in each run.
    """
    command = joint_columns(log, "setpoint_jp", joints)
    rate = 1.0 / float(np.median(np.diff(motion.time, axis=0)[layout.valid[1:]]))
    segments = []
    for k in range(layout.rows.shape[1]):
        path = _run_out(command[layout.rows[: _length(layout.rows[:, k]), k]], len(layout.rows))
        segments.append(
            Segment(
                path,
                np.zeros(len(path), dtype=np.int64),
                int(motion.session[k]),
                float(motion.time[0, k]),
                float(payload[k]),
            )
        )
    return plan_of(segments, rate)


def _length(rows: IntArray) -> int:
    """Return the number of different rows of a column, whose end repeats its last row."""
    return int(np.argmax(rows)) + 1


def _run_out(path: FloatArray, n: int) -> FloatArray:
    """Let a path `(m, dof)` that ends before the grid's n samples swing on, its last acceleration kept.

    A hard stop would be an acceleration that no motor was asked for, and the interpolation would spread it backwards.
    """
    more, last = min(RUN_OUT, n - len(path)), path[-LAST:]
    if more <= 0 or len(last) < LAST:
        return path
    t = np.arange(1 - LAST, more + 1)
    on = np.polynomial.polynomial.polyval(t[LAST:], np.polynomial.polynomial.polyfit(t[:LAST], last - last[-1], 2))
    return np.concatenate([path, last[-1] + on.T])
