"""Motions: what two clocks both saw, as bare arrays, and the pairs of them that a log holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.order import rising
from gpcorrect.logs.streams import Stream
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array

REFERENCES = {
    "tracker_cp": ("measured_cp", "setpoint_cp"),
    "external_jp": ("measured_jp", "setpoint_jp"),
    "measured_cp": ("setpoint_cp",),
    "measured_jp": ("setpoint_jp",),
}
"""What an observed signal is compared with: first what the robot reports, for it holds least servo lag."""
STILL = 1e-6  # a joint that spans less than this fraction of the widest joint does not move


@dataclass(frozen=True, eq=False)
class Motion:
    """Points that moved, on one clock."""

    time: FloatArray  # (n,) stamps, s, of any spacing; samples out of order are left out
    # (n, k) positions in any frame, or joint positions; a row with NaN is a missing sample and left out
    values: FloatArray
    # (n, m) further columns that a constant matrix may mix into what the other clock saw: the nine entries of the
    # rotation matrix stand for an unknown lever arm between the two points
    lever: FloatArray | None = None
    label: IntArray | None = None  # (n,) trajectory of each sample, for offsets trajectory by trajectory

    def __post_init__(self) -> None:
        time, values = np.asarray(self.time, dtype=np.float64), np.asarray(self.values, dtype=np.float64)
        lever = np.empty((len(time), 0)) if self.lever is None else np.asarray(self.lever, dtype=np.float64)
        if time.ndim != 1 or values.ndim != 2 or len(values) != len(time) or len(lever) != len(time):
            raise DataError(f"a motion is time (n,) and values (n, k), got {time.shape} and {values.shape}.")
        known = np.isfinite(time) & np.isfinite(values).all(axis=1) & np.isfinite(lever).all(axis=1)
        rows = np.flatnonzero(known)[rising(time[known])]
        for name, array in (("time", time), ("values", values)):
            object.__setattr__(self, name, frozen_array(array[rows]))
        object.__setattr__(self, "lever", frozen_array(lever[rows]) if lever.shape[1] else None)
        if self.label is not None:
            object.__setattr__(self, "label", frozen_array(np.asarray(self.label)[rows], np.int64))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def regressors(self) -> FloatArray:
        """(n, k + m) values beside lever columns."""
        return self.values if self.lever is None else np.hstack([self.values, self.lever])

    def rows(self, keep: BoolArray | IntArray) -> Motion:
        """Return the motion of these rows only.

        Parameters
        ----------
        keep : (n,) bool array of those to take, or their numbers
        """
        lever = None if self.lever is None else self.lever[keep]
        label = None if self.label is None else self.label[keep]
        return Motion(self.time[keep], self.values[keep], lever, label)


@dataclass(frozen=True, eq=False)
class MotionPair:
    """One motion as two clocks saw it: the robot's own record, and an observer's."""

    # what the robot commanded or reported: the smoother one, because it is the one that is interpolated
    reference: Motion
    # what the other clock stamped; its values keep the reference's column order only when they are joints
    observed: Motion


def stretches(pair: MotionPair, gap: float, margin: float) -> Iterator[MotionPair]:
    """Cut a pair where the reference pauses; observed samples near each piece go with it.

    Parameters
    ----------
    pair : MotionPair
    gap : float, a longer pause cuts, s
    margin : float, observed samples at most so far outside a piece go with it, s
    """
    reference, observed = pair.reference, pair.observed
    if len(reference) == 0:
        return
    breaks = np.flatnonzero(np.diff(reference.time) > gap) + 1
    for rows in np.split(np.arange(len(reference)), breaks):
        start, stop = reference.time[rows[0]] - margin, reference.time[rows[-1]] + margin
        yield MotionPair(reference.rows(rows), observed.rows((observed.time >= start) & (observed.time <= stop)))


def pairs_of(log: CalibrationLog, observed: str, reference: str) -> list[MotionPair]:
    """Two signals of a log, both poses or both joints, as a pair for each run of the clock.

    With an offset, the end of one motion is among the observed samples of the next: trajectories of one run stay
    together.

    Parameters
    ----------
    log : CalibrationLog, with a clock
    observed, reference : str, names of the signals; LogError where one is absent, or one is a pose and the other joints
    """
    for name in (observed, reference):
        if name not in log.signals or name in log.SCALARS:
            raise LogError(f"the log has no motion signal {name}.", hint=f"It has {', '.join(log.signals)}.")
    values, lever, seen = _columns(getattr(log, reference), getattr(log, observed), (reference, observed))
    return [
        MotionPair(
            Motion(log.time[rows], values[rows], None if lever is None else lever[rows]),
            Motion(log.time[rows], seen[rows], label=log.trajectory[rows]),
        )
        for rows in clock_runs(log)
    ]


def clock_runs(log: CalibrationLog) -> Iterator[IntArray]:
    """Yield the rows through which one clock ran on: it stops where a trajectory starts no later, or a session ends.

    Parameters
    ----------
    log : CalibrationLog, with a clock
    """
    parts: list[IntArray] = []
    for _, rows in log.trajectories():
        before = parts[-1] if parts else rows
        same = log.session[before[-1]] == log.session[rows[0]]
        if parts and not (same and log.time[rows].min() > log.time[before].max()):
            yield np.concatenate(parts)
            parts = []
        parts.append(rows)
    if parts:
        yield np.concatenate(parts)


def stream_pair(observed: Stream, reference: Stream) -> MotionPair:
    """Two streams as one pair, each on its own clock, both poses or both joints.

    Parameters
    ----------
    observed, reference : Stream, what the other clock stamped, and the robot's record
    """
    values, lever, seen = _columns(reference.values, observed.values, (reference.name, observed.name))
    return MotionPair(Motion(reference.stamp, values, lever), Motion(observed.stamp, seen))


def _columns(
    reference: PoseSignal | FloatArray, observed: PoseSignal | FloatArray, names: tuple[str, str]
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Return what is compared: reference values and lever columns, observed values."""
    if isinstance(reference, PoseSignal) and isinstance(observed, PoseSignal):
        return reference.position, _lever(reference), observed.position
    if isinstance(reference, PoseSignal) or isinstance(observed, PoseSignal):
        raise LogError(f"cannot compare {names[1]} with {names[0]}: one is a pose, the other joints.")
    # Joints that move, each in units of its own span, so that radians and metres weigh alike.
    dof, known = min(reference.shape[1], observed.shape[1]), np.isfinite(reference).all(axis=1)
    reference, observed = reference[:, :dof], observed[:, :dof]
    if not known.any():
        return reference, None, observed
    span: FloatArray = np.ptp(reference[known], axis=0)
    moving = span > STILL * max(float(span.max()), np.finfo(float).tiny)
    return reference[:, moving] / span[moving], None, observed[:, moving] / span[moving]


def _lever(signal: PoseSignal) -> FloatArray | None:
    """Entries of the rotation matrices `(n, 9)`, None where most orientations are unknown."""
    if signal.quaternion is None:
        return None
    norm = np.linalg.norm(signal.quaternion, axis=1)
    usable = (norm > 0.5) & (norm < 2.0)
    if 2 * usable.sum() <= len(usable):
        return None
    return se3.matrix_from_quaternion(np.where(usable[:, None], signal.quaternion, np.nan)).reshape(-1, 9)
