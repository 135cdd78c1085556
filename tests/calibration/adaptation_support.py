"""Recordings of the small robot as it ages: the same miss, and on top one that was not there at the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support import small_log

from gpcorrect.types import CalibrationLog, PoseSignal


def aged_log(seed: int, amount: float, trajectories: int = 10) -> CalibrationLog:
    """Return a recording whose commands miss by further `amount` metres, wavelike over the workspace."""
    log = small_log(seed, trajectories, samples=40)
    assert log.tracker_cp is not None
    assert log.setpoint_cp is not None
    p = log.tracker_cp.position
    extra = amount * np.sin(40 * p[:, [1, 2, 0]])
    return replace(log, setpoint_cp=PoseSignal(log.setpoint_cp.position + extra, log.setpoint_cp.quaternion))
