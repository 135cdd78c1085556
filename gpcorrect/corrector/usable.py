"""The samples that can be learned from: both poses, and a velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import observed_twists
from gpcorrect.errors import LogError
from gpcorrect.rigid import register
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

__all__ = ["MIN_SAMPLES", "Pairs", "require_learnable", "usable_pairs"]

MIN_SAMPLES = 20


@dataclass(frozen=True, eq=False)
class Pairs:
    """The samples that are learned from, in step: observed and commanded poses, twists, trajectories."""

    observed: PoseSignal
    command: PoseSignal
    twist: FloatArray
    trajectory: IntArray
    time: FloatArray


def usable_pairs(log: CalibrationLog, keep: BoolArray, velocity_step: float | None) -> Pairs:
    """Kept samples with both poses and a velocity.

    Raises
    ------
    LogError
        There are too few, or the log lacks a signal.
    """
    observed, command = pose_pair(log)
    if not (observed.finite & command.finite).any():
        raise LogError(
            f"no sample of {len(log)} has both poses complete (tracker_cp: {int(observed.finite.sum())},"
            f" setpoint_cp: {int(command.finite.sum())}).",
            hint="Look for missing numbers, quaternions not of norm 1, clocks apart: gpcorrect validate",
            path=log.name,
        )
    twist = observed_twists(log.time, log.trajectory, observed, keep, velocity_step)
    rows = keep & observed.finite & command.finite & np.isfinite(twist[:, :3]).all(axis=1)
    if rows.sum() < MIN_SAMPLES:
        raise LogError(
            f"only {int(rows.sum())} of {len(log)} samples can be learned from; at least {MIN_SAMPLES} are needed.",
            hint="Look at what is wrong with the recording: gpcorrect validate LOG; or keep everything: --no-clean",
            path=log.name,
        )
    return Pairs(observed[rows], command[rows], twist[rows], log.trajectory[rows], log.time[rows])


def require_learnable(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no correction can be learned whatever the cleaning keeps.

    Raises
    ------
    LogError
        A signal is missing, or too few samples have both poses and a velocity.
    DegenerateError
        The motion does not determine a registration.
    """
    pairs = usable_pairs(log, np.ones(len(log), dtype=bool), None)
    register(pairs.observed, pairs.command, pairs.trajectory, "none")
