"""Motions: what two clocks both saw, as bare arrays, and the pairs of them that a log holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.order import rising
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array

__all__ = ["PREFERRED_PAIRS", "Motion", "MotionPair", "default_pair", "pairs_of", "stretches"]

PREFERRED_PAIRS = (
    (
        "tracker_cp",
        "measured_cp",
    ),  # what the robot reports moves with the robot: the pair holds least servo lag
    ("tracker_cp", "setpoint_cp"),
    ("external_jp", "measured_jp"),
    ("external_jp", "setpoint_jp"),
    ("measured_cp", "setpoint_cp"),
    ("measured_jp", "setpoint_jp"),
)
STILL_SHARE = 1e-6  # a joint that spans less than this share of the widest joint does not move


@dataclass(frozen=True, eq=False)
class Motion:
    """Points that moved, on one clock.

    Parameters
    ----------
    time : (n,) array
        Stamps, s, of any spacing; samples out of order are left out.
    values : (n, k) array
        Positions in any frame, or joint positions; a row with NaN is a missing sample and left out.
    lever : (n, m) array or None
        Further columns that a constant matrix may mix into what the other clock saw: the nine entries of
        the rotation matrix stand for an unknown lever arm between the two points.
    """

    time: FloatArray
    values: FloatArray
    lever: FloatArray | None = None

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

    def __len__(self) -> int:
        return len(self.time)

    @property
    def regressors(self) -> FloatArray:
        """(n, k + m) values beside lever columns."""
        return self.values if self.lever is None else np.hstack([self.values, self.lever])

    def rows(self, keep: BoolArray) -> Motion:
        """Return the motion of these rows only."""
        return Motion(self.time[keep], self.values[keep], None if self.lever is None else self.lever[keep])


@dataclass(frozen=True, eq=False)
class MotionPair:
    """One motion as two clocks saw it: the robot's own record, and an observer's.

    Parameters
    ----------
    reference : Motion
        What the robot commanded or reported: the smoother one, because it is the one that is interpolated.
    observed : Motion
        What the other clock stamped; its values keep the reference's column order only when they are joints.
    """

    reference: Motion
    observed: Motion


def stretches(pair: MotionPair, gap: float, margin: float) -> Iterator[MotionPair]:
    """Cut a pair where the reference pauses for over `gap` s; observed samples within `margin` s follow."""
    reference, observed = pair.reference, pair.observed
    if len(reference) == 0:
        return
    breaks = np.flatnonzero(np.diff(reference.time) > gap) + 1
    for rows in np.split(np.arange(len(reference)), breaks):
        keep = np.zeros(len(reference), dtype=np.bool_)
        keep[rows] = True
        start, stop = reference.time[rows[0]] - margin, reference.time[rows[-1]] + margin
        yield MotionPair(
            reference.rows(keep), observed.rows((observed.time >= start) & (observed.time <= stop))
        )


def default_pair(log: CalibrationLog) -> tuple[str, str]:
    """Names of the observed and the reference signal to compare: the first of PREFERRED_PAIRS in the log.

    Raises
    ------
    LogError
        The log holds no two signals of one motion.
    """
    for observed, reference in PREFERRED_PAIRS:
        if observed in log.signals and reference in log.signals:
            return observed, reference
    raise LogError(
        f"expected two signals of one motion, got {', '.join(log.signals) or 'no signal'}.",
        hint="Record the command (setpoint_cp or setpoint_jp) beside what was observed.",
    )


def pairs_of(log: CalibrationLog, observed: str, reference: str) -> list[MotionPair]:
    """One pair a trajectory of two signals of a log, both poses or both joints.

    Raises
    ------
    LogError
        A signal is absent, or one is a pose and the other joints.
    """
    first, second = _signal(log, reference), _signal(log, observed)
    if isinstance(first, PoseSignal) and isinstance(second, PoseSignal):
        tables = (first.position, _lever(first), second.position)
    elif not isinstance(first, PoseSignal) and not isinstance(second, PoseSignal):
        a, b = _comparable_joints(first, second)
        tables = (a, None, b)
    else:
        raise LogError(f"cannot compare {observed} with {reference}: one is a pose, the other joints.")
    return [_pair(log.time, tables, rows) for _, rows in log.trajectories()]


def _signal(log: CalibrationLog, name: str) -> PoseSignal | FloatArray:
    if name not in log.signals or name in log.SCALARS:
        raise LogError(f"the log has no motion signal {name}.", hint=f"It has {', '.join(log.signals)}.")
    value: PoseSignal | FloatArray = getattr(log, name)
    return value


def _pair(
    time: FloatArray, tables: tuple[FloatArray, FloatArray | None, FloatArray], rows: IntArray
) -> MotionPair:
    values, lever, seen = tables
    return MotionPair(
        Motion(time[rows], values[rows], None if lever is None else lever[rows]),
        Motion(time[rows], seen[rows]),
    )


def _lever(signal: PoseSignal) -> FloatArray | None:
    """Entries of the rotation matrices `(n, 9)`, None where there are no orientations at all."""
    if signal.quaternion is None:
        return None
    entries = np.full((len(signal), 9), np.nan)
    norm = np.linalg.norm(signal.quaternion, axis=1)
    usable = (norm > 0.5) & (norm < 2.0)
    if not usable.any():
        return None
    entries[usable] = se3.matrix_from_quaternion(signal.quaternion[usable]).reshape(-1, 9)
    return entries


def _comparable_joints(reference: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Joints that move, each in units of its own span, so that radians and metres weigh alike."""
    dof = min(reference.shape[1], observed.shape[1])
    known = np.isfinite(reference).all(axis=1)
    if not known.any():
        return reference[:, :dof], observed[:, :dof]
    span: FloatArray = np.ptp(reference[known, :dof], axis=0)
    moving = span > STILL_SHARE * max(float(span.max()), np.finfo(float).tiny)
    return reference[:, :dof][:, moving] / span[moving], observed[:, :dof][:, moving] / span[moving]
