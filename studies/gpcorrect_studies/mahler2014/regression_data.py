"""What the regression of a fitted corrector sees of a log: inputs, the residuals it should give, and the way back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.corrector import CommandCorrector, observed_twists, pose_pair
from gpcorrect.corrector.reference import reference_twists, rotations_of
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

__all__ = ["RegressionData"]


@dataclass(frozen=True, eq=False)
class RegressionData:
    """Samples in step: inputs `X` (n, d), residuals (n, 6), trajectories and times (n,), and rows of the log (n,)."""

    X: FloatArray
    residual: FloatArray
    trajectory: IntArray
    time: FloatArray
    rows: IntArray
    reference: PoseSignal
    command: PoseSignal

    @classmethod
    def of(cls, corrector: CommandCorrector, log: CalibrationLog, keep: BoolArray) -> Self:
        """Take the samples of `log` with both poses and a velocity, among those kept, after registration."""
        observed, command = pose_pair(log)
        twist = observed_twists(log.time, log.trajectory, observed, keep, corrector.velocity_step)
        rows = np.flatnonzero(keep & observed.finite & command.finite & np.isfinite(twist).all(axis=1))
        reference = corrector.rigid.apply(observed[rows])
        moved = reference_twists(corrector.rigid, rotations_of(observed[rows]), twist[rows])
        return cls(
            X=corrector.features.transform(reference.position, rotations_of(reference), moved),
            residual=pose_residual(reference, command[rows]),
            trajectory=log.trajectory[rows],
            time=log.time[rows],
            rows=rows,
            reference=reference,
            command=command[rows],
        )

    def mean_errors(self, predicted: FloatArray) -> dict[str, float]:
        """Mean lengths of position (mm) and rotation error (deg) when these residuals `(n, 6)` are applied."""
        left = pose_residual(apply_residual(self.reference, predicted), self.command)
        lengths = np.linalg.norm(left.reshape(-1, 2, 3), axis=2).mean(axis=0)
        return {"position_mm": 1e3 * float(lengths[0]), "rotation_deg": float(np.rad2deg(lengths[1]))}
