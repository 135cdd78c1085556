"""A log as a fitted corrector sees it: inputs of its regression and the residuals that were to be predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.corrector.command import CommandCorrector
from gpcorrect.corrector.memory import History
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import observed_twists, reference_twists, rotations_of
from gpcorrect.errors import LogError
from gpcorrect.play import path_labels
from gpcorrect.rigid import pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

__all__ = ["LogSamples", "log_samples"]


@dataclass(frozen=True, eq=False)
class LogSamples:
    """Samples of a log with both poses and a velocity.

    Parameters
    ----------
    X : (n, d) array
        Features of pose and velocity.
    X_recall : (n, d + h) array or None
        The same and memory features; None for a corrector without memory.
    residual : (n, m) array
        What the regression should predict: m, then rad; m is 3 for a position-only corrector.
    trajectory, time : (n,) arrays
    """

    X: FloatArray
    X_recall: FloatArray | None
    residual: FloatArray
    trajectory: IntArray
    time: FloatArray


def log_samples(corrector: CommandCorrector, log: CalibrationLog, keep: BoolArray) -> LogSamples:
    """Return what `corrector` can learn from, or be judged by, in the samples `keep` (n,) of a log.

    Raises
    ------
    LogError
        The log lacks `tracker_cp` or `setpoint_cp`, orientations that the corrector needs, or any good sample.
    """
    observed, command = pose_pair(log)
    if corrector.has_orientation and observed.quaternion is None:
        raise LogError("the model corrects orientations, and the log holds none.", path=log.name)
    if not corrector.has_orientation:
        observed, command = PoseSignal(observed.position), PoseSignal(command.position)
    twist = observed_twists(log.time, log.trajectory, observed, keep, corrector.velocity_step)
    rows = np.flatnonzero(keep & observed.finite & command.finite & np.isfinite(twist[:, :3]).all(axis=1))
    if rows.size == 0:
        raise LogError(
            "no sample that passes cleaning has both poses and a velocity.",
            hint="See: gpcorrect validate LOG",
            path=log.name,
        )
    reference, trajectory = corrector.rigid.apply(observed[rows]), log.trajectory[rows]
    turned = rotations_of(reference)
    moved = reference_twists(corrector.rigid, rotations_of(observed[rows]), twist[rows])
    X = corrector.features.transform(reference.position, turned, moved)
    recall = corrector.recall
    wide = None
    if recall is not None:
        labels = path_labels(log.time[rows], log.session[rows])
        history = History.of(command[rows], reference, labels, orientation=corrector.has_orientation)
        wide = np.hstack([X, recall.memory.transform(history)])
    residual = pose_residual(reference, command[rows])[:, : 6 if corrector.has_orientation else 3]
    return LogSamples(X, wide, residual, trajectory, log.time[rows])
