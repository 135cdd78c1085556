"""A tracker that reports positions only, of a marker off the tool tip: seen by how errors turn with commands."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.types import CalibrationLog, FloatArray, IntArray


def lever_note(log: CalibrationLog, rows: IntArray, reference: FloatArray, left: FloatArray) -> tuple[str, ...]:
    """Return a note where a marker away from the tip explains much of what a registration of positions leaves.

    A marker at `a` in the tool's frame shows `u + R_cmd a`, so residuals hold `-R_cmd a`. That is fitted beside a small
    turn and shift of the frames to one half of the trajectories, and measured on the other, both ways.

    Parameters
    ----------
    log : CalibrationLog, n samples; nothing is returned where the tracker has orientations, or commands have none
    rows : (k,) int array, samples that were registered
    reference, left : (k, 3) arrays, registered positions, and commands minus these, m
    """
    tracker, command = log.tracker_cp, log.setpoint_cp
    if tracker is None or command is None or tracker.quaternion is not None or command.quaternion is None:
        return ()
    ok = np.isfinite(command.quaternion[rows]).all(axis=1)
    R, reference, left = se3.matrix_from_quaternion(command.quaternion[rows][ok]), reference[ok], left[ok]
    frames = np.concatenate([np.broadcast_to(np.eye(3), R.shape), se3.hat(reference - reference.mean(axis=0))], axis=2)
    design, y = np.concatenate([frames, -R], axis=2), left[:, :, None]
    trajectory = log.trajectory[rows][ok]
    first = trajectory <= np.median(np.unique(trajectory))
    if first.all():
        return ()
    before, after = (
        sum(_misfit(x[half], y[half], x[~half], y[~half]) for half in (first, ~first)) for x in (frames, design)
    )
    if not after < (1.0 - LIMITS.lever_explains) * before:
        return ()
    a = np.linalg.lstsq(design.reshape(-1, 9), y.reshape(-1), rcond=None)[0][6:]
    where = ", ".join(f"{1e3 * length:.0f}" for length in a)
    return (
        f"the tracker reports positions only, of a marker that seems to be {1e3 * np.linalg.norm(a):.0f} mm from the "
        f"commanded point ({where} mm in the commanded tool's frame), which explains {1 - after / before:.0%} of what "
        "registration leaves and follows from orientations, that are not learned from here. Track the orientation too; "
        "or record and ask for the marker's position: setpoint_cp plus these millimetres, turned by its orientation",
    )


def _misfit(x: FloatArray, y: FloatArray, other_x: FloatArray, other_y: FloatArray) -> float:
    """Return the sum of squares that a fit to some samples leaves of others."""
    found = np.linalg.lstsq(x.reshape(-1, x.shape[2]), y.reshape(-1), rcond=None)[0]
    return float(((other_y[:, :, 0] - other_x @ found) ** 2).sum())
