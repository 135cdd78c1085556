"""What cleaning compares in a log: an observed and a commanded signal, as samples with their error in groups.

Poses have two groups of three numbers, position and rotation (or the position alone); joints a group of one number
each. A group's unit is written "P" (m) or "R" (rad), as joint types are.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.rigid import RigidModel, pose_residual
from gpcorrect.types import QUATERNION_TOLERANCE, BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import derivative, segment_labels, twists

PAUSE = 5.0  # a step between trajectories this many times their own is a pause: a gap of velocities is one too
RIGID_FREEDOMS = 6  # parameters of a rigid motion
FEWEST_OF_SESSION = 12  # samples: a session of fewer has the zero of the whole log, not one of its own


@dataclass(frozen=True)
class Pair:
    """The two signals of a log that are held against each other.

    Parameters
    ----------
    observed : str, signal of the outside sensor: "tracker_cp" or "external_jp"
    command : str, signal of the robot: "setpoint_cp", "measured_cp", "measured_jp" or "setpoint_jp"
    orientation : bool, whether orientations are compared too, where both signals have them
    """

    observed: Literal["tracker_cp", "external_jp"]
    command: Literal["setpoint_cp", "measured_cp", "measured_jp", "setpoint_jp"]
    orientation: bool = True

    @property
    def joints(self) -> bool:
        """Whether joints are compared, not poses."""
        return self.observed == "external_jp"


POSES = Pair("tracker_cp", "setpoint_cp")
TOOL = Pair("tracker_cp", "measured_cp", orientation=False)


def joint_pair(input_signal: Literal["measured_jp", "setpoint_jp"]) -> Pair:
    """Return the pair that holds outside encoders against `input_signal`.

    Parameters
    ----------
    input_signal : "measured_jp" or "setpoint_jp", reported or commanded joint positions
    """
    return Pair("external_jp", input_signal)


@dataclass(frozen=True, eq=False)
class Samples:
    """n complete samples of a recording in recorded order, g groups of w numbers each."""

    time: FloatArray  # (n,) seconds
    # (n,) each: motion, and recording day or homing
    trajectory: IntArray
    session: IntArray
    run: IntArray  # (n,) unbroken stretch of the recording, across trajectories where nothing lies between them
    units: str  # "P" (m) or "R" (rad) for each group
    # (n, k), a group each: positions (k = 3) and quaternions wxyz (k = 4) in the command's frame, or one joint (k = 1)
    observed: tuple[FloatArray, ...]
    command: tuple[FloatArray, ...]
    # (n, g, w) command minus observation; for rotations the rotation vector of `R_cmd R_obs^T`. Of joints each
    # session's median is taken out, since homing moves their zero.
    error: FloatArray
    # (n, k) each, coordinates of the command: position and rotation-matrix entries, or a joint each
    place: tuple[FloatArray, ...]
    # (n, w) each, velocity of the command, m/s or rad/s, for poses always linear and angular; zero where a run is too
    # short
    velocity: tuple[FloatArray, ...]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: IntArray | BoolArray) -> Samples:
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "units"}
        taken: dict[str, Any] = {
            k: tuple(g[rows] for g in v) if isinstance(v, tuple) else v[rows] for k, v in values.items()
        }
        return replace(self, **taken)

    @property
    def joints(self) -> bool:
        """Whether these are joints, not poses."""
        return bool(self.error.shape[2] == 1)

    @property
    def error_lengths(self) -> FloatArray:
        """(n, g) lengths of the error's groups, m or rad."""
        return np.asarray(np.linalg.norm(self.error, axis=2))

    def steps(self, signal: tuple[FloatArray, ...], i: IntArray, j: IntArray) -> FloatArray:
        """Return the distances (m, g), m or rad, of a signal's groups between samples i and j (m,) each.

        Parameters
        ----------
        signal : tuple of (n, k) arrays, observed or commanded groups
        i, j : (m,) array, samples
        """
        pairs = [(values[i], values[j]) for values in signal]
        return np.stack(
            [se3.quaternion_angle(a, b) if a.shape[1] == 4 else np.linalg.norm(a - b, axis=1) for a, b in pairs], axis=1
        )

    def trend_inputs(self, group: int) -> FloatArray:
        """Return what an error may be proportional to: the position and the group's velocity, or both of the joint.

        Parameters
        ----------
        group : int, which group
        """
        return np.hstack([self.place[group if self.joints else 0], self.velocity[group]])

    def centred(self, values: FloatArray) -> FloatArray:
        """Return values (n, ...) less the median of their session, which only joints have a zero for.

        Parameters
        ----------
        values : (n, ...) array, errors
        """
        return _centred(values, self.session) if self.joints else values

    @property
    def fresh(self) -> float:
        """How many of the samples are new: neighbours in time repeat each other.

        A recording is new each time the command has travelled the spread of its coordinates, in the group that
        travels most for joints, in position and rotation together for poses.
        """
        if len(self) == 0:
            return 0.0
        counts = [_traverses(coordinates, self.run) for coordinates in self.place]
        return min(float(len(self)), max(counts) if self.joints else sum(counts))

    @property
    def small_sample_factor(self) -> float:
        """Factor `1 + 5/(n - p)` on robust scales (Rousseeuw & Leroy 1987): n fresh samples, p of a rigid motion."""
        return 1.0 + 5.0 / max(1.0, self.fresh - RIGID_FREEDOMS)


def pose_pair(log: CalibrationLog, pair: Pair) -> tuple[PoseSignal, PoseSignal]:
    """Return observed and commanded poses; the observed without orientations where they are not compared.

    Parameters
    ----------
    log : CalibrationLog, recording
    pair : Pair, signals to take; LogError where the log lacks one
    """
    observed, command = (_signal(log, name, pair) for name in (pair.observed, pair.command))
    if command.quaternion is None or not pair.orientation:
        observed = PoseSignal(observed.position)
    return observed, command


def unusable(log: CalibrationLog, pair: Pair, order: IntArray) -> FloatArray:
    """Count (n,) the numbers of a sample that cannot be used: missing, no rotation, or a time that does not advance.

    Parameters
    ----------
    log : CalibrationLog, n samples
    pair : Pair, signals that are compared
    order : (n,) array, rows by trajectory, in the order in which they were recorded, and inside each by time
    """
    count: FloatArray
    if pair.joints:
        count = (~np.isfinite(np.hstack(_joint_signals(log, pair)))).sum(axis=1).astype(np.float64)
    else:
        observed, command = pose_pair(log, pair)
        count = _bad_numbers(observed) + _bad_numbers(command)
    count += ~np.isfinite(log.time)
    same = log.trajectory[order[1:]] == log.trajectory[order[:-1]]
    count[order[1:]] += same & ~(np.diff(log.time[order]) > 0)
    return count


def samples_of(log: CalibrationLog, pair: Pair, rows: IntArray, rigid: RigidModel) -> Samples:
    """Return the samples at some rows of a log.

    Parameters
    ----------
    log : CalibrationLog, recording
    pair : Pair, signals to compare
    rows : (n,) array, complete samples in recorded order
    rigid : RigidModel, registration of the observed poses; joints need none
    """
    time, trajectory, session = log.time[rows], log.trajectory[rows], log.session[rows]
    stretch = (time, trajectory, session, _recording_runs(time, trajectory, session))
    if pair.joints:
        return _joint_samples(log, pair, rows, stretch)
    observed, command = (signal[rows] for signal in pose_pair(log, pair))
    mapped = rigid.apply(observed)
    rotation = None if command.quaternion is None else se3.matrix_from_quaternion(command.quaternion)
    error = pose_residual(mapped, command)
    seen, wanted, units = (mapped.position,), (command.position,), "P"
    if mapped.quaternion is not None and command.quaternion is not None:
        seen, wanted, units = (*seen, mapped.quaternion), (*wanted, command.quaternion), "PR"  # type: ignore[assignment]
    twist = np.nan_to_num(twists(time, command.position, rotation, stretch[3]))
    place = (command.position,) if rotation is None else (command.position, rotation.reshape(-1, 9))
    error = error[:, : 3 * len(units)].reshape(len(rows), len(units), 3)
    return Samples(*stretch, units, seen, wanted, error, place, (twist[:, :3], twist[:, 3:]))


def _joint_samples(
    log: CalibrationLog, pair: Pair, rows: IntArray, stretch: tuple[FloatArray, IntArray, IntArray, IntArray]
) -> Samples:
    """Return samples of joints, a group each."""
    observed, command = (signal[rows] for signal in _joint_signals(log, pair))
    types = log.joint_types(observed.shape[1])
    velocity = np.nan_to_num(derivative(stretch[0], command, stretch[3]))
    error = _centred(command - observed, stretch[2])
    seen, wanted, speed = (tuple(part[:, [j]] for j in range(len(types))) for part in (observed, command, velocity))
    return Samples(*stretch, types, seen, wanted, error[:, :, None], wanted, speed)


def _joint_signals(log: CalibrationLog, pair: Pair) -> tuple[FloatArray, FloatArray]:
    """Return observed and commanded joints (n, dof) each."""
    observed, command = (_signal(log, name, pair) for name in (pair.observed, pair.command))
    if observed.shape != command.shape:
        raise LogError(
            f"{pair.command} has {command.shape[1]} joints, {pair.observed} {observed.shape[1]}.",
            hint="Name the same joints in both: a mapping file given with --columns says which columns are which.",
            path=log.name,
        )
    return observed, command


def _signal(log: CalibrationLog, name: str, pair: Pair) -> Any:
    signal = getattr(log, name)
    if signal is None:
        raise LogError(
            f"cleaning compares {pair.observed} with {pair.command}, but the log has no {name}.",
            hint=f"It has: {', '.join(log.signals) or 'no signals'}.",
            path=log.name,
        )
    return signal


def _bad_numbers(signal: PoseSignal) -> FloatArray:
    """Count (n,) of missing numbers in a sample's pose, a quaternion that is not of unit norm counting as four."""
    count: FloatArray = (~np.isfinite(signal.position)).sum(axis=1).astype(np.float64)
    if signal.quaternion is not None:
        missing = (~np.isfinite(signal.quaternion)).sum(axis=1)
        skewed = np.abs(np.linalg.norm(signal.quaternion, axis=1) - 1.0) > QUATERNION_TOLERANCE
        count += np.where(missing == 0, 4.0 * skewed, missing)
    return count


def _centred(values: FloatArray, session: IntArray) -> FloatArray:
    """Values (n, ...) less the median of their session, or of all where a session has few samples."""
    zero = np.broadcast_to(np.median(values, axis=0), values.shape).copy() if len(values) else np.array(values)
    for number in np.unique(session):
        rows = session == number
        if rows.sum() >= FEWEST_OF_SESSION:
            zero[rows] = np.median(values[rows], axis=0)
    return values - zero


def _recording_runs(time: FloatArray, trajectory: IntArray, session: IntArray) -> IntArray:
    """Return the unbroken stretch of the recording, its number, that each of n samples lies in.

    Inside a trajectory a gap breaks it, as for velocities; between trajectories, a pause, another session or another
    clock.
    """
    step, inside = np.diff(time), np.diff(trajectory) == 0
    labels = segment_labels(time, trajectory)
    breaks: BoolArray = np.diff(labels) != 0
    typical = _typical_steps(time, trajectory)
    follows = (step > 0) & (step <= PAUSE * np.minimum(typical[1:], typical[:-1])) & (np.diff(session) == 0)
    breaks = np.where(inside, breaks | (np.diff(session) != 0), ~follows)
    return np.concatenate([[0], np.cumsum(breaks)])[: len(time)]


def _typical_steps(time: FloatArray, trajectory: IntArray) -> FloatArray:
    """Median step (n,) in s of the trajectory that each sample lies in; 0 where it is alone."""
    typical = np.zeros(len(time))
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(trajectory)) + 1, [len(time)]])
    for start, stop in pairwise(bounds):
        if stop - start > 1:
            typical[start:stop] = np.median(np.diff(time[start:stop]))
    return typical


def _traverses(coordinates: FloatArray, run: IntArray) -> float:
    """Length of a path (n, d), not counted across runs, over its spread; one more for each run."""
    spread = float(np.median(np.linalg.norm(coordinates - np.median(coordinates, axis=0), axis=1)))
    steps = np.linalg.norm(np.diff(coordinates, axis=0), axis=1)[run[1:] == run[:-1]]
    return len(np.unique(run)) + (float(steps.sum()) / spread if spread > 0 else 0.0)
