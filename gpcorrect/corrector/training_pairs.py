"""The samples of a log that are learned from, and what the regression is given of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.corrector.learn_memory import Samples
from gpcorrect.corrector.memory import History
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import observed_twists, reference_twists, rotations_of
from gpcorrect.errors import LogError
from gpcorrect.gpr import FeatureMap
from gpcorrect.play import path_labels
from gpcorrect.rigid import RigidModel, pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

__all__ = ["TrainingPairs", "complete_pair"]

MIN_SAMPLES = 20
CHECK_QUERIES = 8


def complete_pair(log: CalibrationLog) -> tuple[PoseSignal, PoseSignal]:
    """Return observed and commanded poses of a log in which some sample has both.

    Raises
    ------
    LogError
        A signal is missing, or no sample has both.
    """
    observed, command = pose_pair(log)
    if not (observed.finite & command.finite).any():
        raise LogError(
            f"no sample of {len(log)} has both poses complete (tracker_cp: {int(observed.finite.sum())},"
            f" setpoint_cp: {int(command.finite.sum())}).",
            hint="Look for missing numbers, quaternions not of norm 1, clocks apart: gpcorrect validate",
            path=log.name,
        )
    return observed, command


@dataclass(frozen=True, eq=False)
class TrainingPairs:
    """The samples that are learned from, in step: observed and commanded poses, twists, trajectories."""

    observed: PoseSignal
    command: PoseSignal
    twist: FloatArray
    trajectory: IntArray
    time: FloatArray
    session: IntArray

    @classmethod
    def of(cls, log: CalibrationLog, keep: BoolArray, velocity_step: float | None) -> Self:
        """Return the kept samples (n,) with both poses and a velocity.

        Raises
        ------
        LogError
            There are too few of them, or the log lacks a signal.
        """
        observed, command = complete_pair(log)
        twist = observed_twists(log.time, log.trajectory, observed, keep, velocity_step)
        rows = keep & observed.finite & command.finite & np.isfinite(twist[:, :3]).all(axis=1)
        if rows.sum() < MIN_SAMPLES:
            raise LogError(
                f"only {int(rows.sum())} of {len(log)} samples can be learned from; at least {MIN_SAMPLES} are needed.",
                hint="Look at what is wrong with the recording: gpcorrect validate LOG; or keep everything: --no-clean",
                path=log.name,
            )
        return cls(observed[rows], command[rows], twist[rows], log.trajectory[rows], log.time[rows], log.session[rows])

    def samples(self, rigid: RigidModel, kinds: tuple[str, ...]) -> tuple[FeatureMap, Samples]:
        """Return the features of these kinds, fitted, and with them what the residual is learned from."""
        reference = rigid.apply(self.observed)
        rotations = rotations_of(reference)
        twist = reference_twists(rigid, rotations_of(self.observed), self.twist)
        features = FeatureMap(kinds).fit(reference.position, rotations, twist)
        residual = pose_residual(reference, self.command)
        X = features.transform(reference.position, rotations, twist)
        labels = path_labels(self.time, self.session)
        history = History.of(self.command, reference, labels, orientation=features.has_orientation)
        return features, Samples(X, features.groups, residual, history, self.trajectory)

    @property
    def check_queries(self) -> FloatArray:
        """Training queries `(k, 13)` spread over the recording: pose (unturned in a position-only log) and twist."""
        rows = np.unique(np.linspace(0, len(self.observed) - 1, CHECK_QUERIES).astype(np.int64))
        observed = self.observed[rows]
        unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
        quaternion = unturned if observed.quaternion is None else observed.quaternion
        return np.hstack([observed.position, quaternion, np.nan_to_num(self.twist[rows])])
