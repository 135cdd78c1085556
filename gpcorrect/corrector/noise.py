"""How wide a stencil must be for the tracker's noise to stay out of the velocities."""

from __future__ import annotations

import numpy as np

from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["stencil_step"]

NOISE_SHARE = 0.03  # of the typical speed that noise may add to a velocity
WIDEST = 0.06  # s: a wider stencil blurs reversals, where friction acts
STENCIL_GAIN = np.sqrt(130.0) / 12.0  # five-point stencil: standard deviation of a derivative, times step over noise
THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)  # standard deviation of third differences of white noise of unit size
STRIDE = 5  # samples over which a speed is measured: noise counts little, curvature too


def stencil_step(log: CalibrationLog) -> float | None:
    """Return the stencil step, s, that keeps noise below a share of the speed; None where neighbouring samples do.

    The noise of the tracker is read off third differences of its positions, which the motion itself hardly enters at
    the rates where noise matters.
    """
    if log.tracker_cp is None or len(log) <= STRIDE:
        return None
    runs = [log.tracker_cp.position[rows] for _, rows in log.trajectories() if len(rows) > STRIDE]
    steps = [np.diff(log.time[rows]) for _, rows in log.trajectories() if len(rows) > STRIDE]
    if not runs:
        return None
    sample = float(np.median(np.concatenate(steps)))
    noise = MAD_TO_STD / THIRD_DIFFERENCE_GAIN * _median_size([np.diff(p, 3, axis=0) for p in runs])
    speed = _median_norm([p[STRIDE:] - p[:-STRIDE] for p in runs]) / (STRIDE * sample)
    if not speed > 0:
        return None
    step = min(STENCIL_GAIN * noise / (NOISE_SHARE * speed), WIDEST)
    return step if step > sample else None


def _median_size(parts: list[FloatArray]) -> float:
    values = np.abs(np.concatenate(parts))
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0


def _median_norm(parts: list[FloatArray]) -> float:
    values = np.linalg.norm(np.concatenate(parts), axis=1)
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0
