"""From a log to the samples that the rules look at: complete, in recorded order, each trajectory in one stretch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gpcorrect.cleaning.limits import bad_numbers
from gpcorrect.cleaning.samples import RigidMap, Samples, pose_error
from gpcorrect.errors import LogError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import segment_labels

__all__ = ["pose_pair", "recorded_order", "recording_runs", "samples_of", "unusable"]

PAUSE = 5.0  # a step between trajectories this many times their own is a pause


def pose_pair(log: CalibrationLog) -> tuple[PoseSignal, PoseSignal]:
    """Observed and commanded poses; without orientations where either lacks them.

    Raises
    ------
    LogError
        The log lacks `tracker_cp` or `setpoint_cp`.
    """
    observed, command = log.tracker_cp, log.setpoint_cp
    if observed is None or command is None:
        missing = "tracker_cp" if observed is None else "setpoint_cp"
        raise LogError(
            f"cleaning compares observed with commanded poses, but the log has no {missing}.",
            hint=f"It has: {', '.join(log.signals) or 'no signals'}.",
            path=log.name,
        )
    if command.quaternion is None:
        observed = PoseSignal(observed.position)
    return observed, command


def recorded_order(log: CalibrationLog) -> IntArray:
    """Rows (n,) sorted by trajectory, in the order in which they were recorded, and inside each by time."""
    rank = np.empty(len(log), dtype=np.int64)
    for k, (_, rows) in enumerate(log.trajectories()):
        rank[rows] = k
    order: IntArray = np.lexsort((log.time, rank))
    return order


def unusable(log: CalibrationLog, order: IntArray) -> FloatArray:
    """Count (n,) of numbers in a sample that cannot be used: missing, no rotation, or a time that does not advance."""
    count = bad_numbers(*pose_pair(log)) + ~np.isfinite(log.time)
    same = log.trajectory[order[1:]] == log.trajectory[order[:-1]]
    count[order[1:]] += same & ~(np.diff(log.time[order]) > 0)
    return count


def samples_of(log: CalibrationLog, rows: IntArray, rigid: RigidMap) -> Samples:
    """Take the samples at these rows of a log, mapped by `rigid`."""
    observed, command = (signal[rows] for signal in pose_pair(log))
    mapped = rigid.apply(observed)
    time, trajectory = log.time[rows], log.trajectory[rows]
    run = recording_runs(time, trajectory, log.session[rows])
    return Samples(time, trajectory, run, mapped, command, pose_error(mapped, command))


def recording_runs(time: FloatArray, trajectory: IntArray, session: IntArray) -> IntArray:
    """Find the unbroken stretch of the recording, its number, that each of n samples lies in.

    Inside a trajectory a gap breaks it, as for velocities; between trajectories, a pause, another session or another
    clock.
    """
    step, inside = np.diff(time), np.diff(trajectory) == 0
    labels = segment_labels(time, trajectory)
    breaks: BoolArray = np.diff(labels) != 0
    typical = _typical_steps(time, trajectory)
    follows = (step > 0) & (step <= PAUSE * np.minimum(typical[1:], typical[:-1])) & (np.diff(session) == 0)
    breaks = np.where(inside, breaks, ~follows)
    run: IntArray = np.concatenate([[0], np.cumsum(breaks)])[: len(time)]
    return run


def _typical_steps(time: FloatArray, trajectory: IntArray) -> FloatArray:
    """Median step (n,) in s of the trajectory that each sample lies in; 0 where it is alone."""
    typical = np.zeros(len(time))
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(trajectory)) + 1, [len(time)]])
    for start, stop in pairwise(bounds):
        if stop - start > 1:
            typical[start:stop] = np.median(np.diff(time[start:stop]))
    return typical
