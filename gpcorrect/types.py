"""The data that pass between rooms: array aliases, pose signals, logs, corrections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpcorrect.errors import DataError, LogError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

POSITIONS = ("setpoint_jp", "measured_jp", "external_jp")
LONGEST_REACH, LONGEST_STROKE = 1.0, 0.5
"""m: twice what the insertions of the machines and recordings here reach from their zeros (RAVEN-II 0.48, dVRK 0.24),
and twice their stroke."""
REACHED = (5.0, 95.0)  # per cent of a joint's samples: what lies beyond may be faults of a sensor
QUATERNION_TOLERANCE = 1e-3  # of the log format: a norm further from one is a mistake, not rounding


class Progress:
    """A callback for long work; this base does nothing, the command line turns it into a bar."""

    def step(self, stage: str, done: float) -> None:
        """Say how far a stage of the work is.

        Parameters
        ----------
        stage : str
        done : float, finished fraction, 0 to 1
        """


def frozen_array(value: ArrayLike, dtype: type = np.float64) -> NDArray[Any]:
    """Return a read-only copy of `value`, so that neither side can change the other's data.

    Parameters
    ----------
    value : array_like
    dtype : type, of the copy; float64 by default
    """
    array: NDArray[Any] = np.array(value, dtype=dtype)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class PoseSignal:
    """Poses over time, a row a sample.

    Parameters
    ----------
    position : (n, 3) array
        Metres; a row of NaN is a missing sample.
    quaternion : (n, 4) array or None
        Unit quaternions, wxyz; a row of NaN is missing; None when the source measures positions only.
    """

    position: FloatArray
    quaternion: FloatArray | None = None

    def __post_init__(self) -> None:
        position = frozen_array(self.position)
        if position.ndim != 2 or position.shape[1] != 3:
            raise DataError(f"positions must have shape (n, 3), got {position.shape}.")
        object.__setattr__(self, "position", position)
        if self.quaternion is not None:
            quaternion = frozen_array(self.quaternion)
            if quaternion.shape != (len(position), 4):
                raise DataError(f"quaternions must have shape ({len(position)}, 4), got {quaternion.shape}.")
            object.__setattr__(self, "quaternion", quaternion)

    @classmethod
    def of(cls, table: FloatArray) -> Self:
        """Return the poses of a table.

        Parameters
        ----------
        table : (n, 7) or (n, 3) array, positions and quaternions; positions alone
        """
        return cls(table[:, :3], table[:, 3:] if table.shape[1] > 3 else None)

    @property
    def table(self) -> FloatArray:
        """(n, 7) array, positions and quaternions; (n, 3) without orientation."""
        return self.position if self.quaternion is None else np.hstack([self.position, self.quaternion])

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index: Any) -> Self:
        quaternion = None if self.quaternion is None else self.quaternion[index]
        return replace(self, position=self.position[index], quaternion=quaternion)

    @property
    def finite(self) -> BoolArray:
        """(n,) mask of samples with every number present."""
        mask: BoolArray = np.asarray(np.isfinite(self.position).all(axis=1))
        if self.quaternion is not None:
            mask = mask & np.isfinite(self.quaternion).all(axis=1)
        return mask


@dataclass(frozen=True)
class LogMeta:
    """What a log's sidecar says of it; empty text where it says nothing.

    `joint_types` is R or P for each joint, however spaced; other letters are refused with a LogError. `joint_names` are
    the source's, in the order of the columns; empty where unknown. `tracker_base` is T_tracker_base where the source
    states it: translation (m), then rotation vector (rad).
    """

    robot: str = ""
    arm: str = ""
    joint_types: str = ""
    tracker: str = ""
    notes: str = ""
    source: str = ""
    licence: str = ""
    tracker_base: tuple[float, ...] | None = None
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        types = self.joint_types.replace(" ", "").replace(",", "").upper()
        if set(types) - set("RP"):
            hint = "Correct the sidecar."
            raise LogError(f"joint_types {self.joint_types!r} does not name each joint with R or P.", hint=hint)
        object.__setattr__(self, "joint_types", types)
        if len(set(self.joint_names)) < len(self.joint_names):
            raise LogError(
                f"joint_names name a joint twice: {', '.join(self.joint_names)}.", hint="Correct the sidecar."
            )


@dataclass(frozen=True, eq=False)
class CalibrationLog:
    """One recording as a table of signals on one clock: the only thing readers yield and learners take.

    Parameters
    ----------
    time : (n,) array
        Seconds, strictly increasing inside a trajectory.
    trajectory, session : (n,) int arrays
        Which motion and which recording day or homing a sample belongs to.
    setpoint_cp, measured_cp, tracker_cp : PoseSignal or None
        Commanded and reported pose (base frame) and outside tracker's pose (tracker frame).
    setpoint_jp, measured_jp, measured_jv, measured_jf, external_jp : (n, dof) arrays or None
        Joint signals, rad or m (velocities a second, efforts N m or N).
    payload, temperature : (n,) arrays or None, kilograms and degrees Celsius
    extra : mapping of name to (n,) array
        Columns outside the log format, carried along and not used.
    meta : LogMeta, robot, arm, tracker and provenance
    name : str, where the log came from, for messages
    digest : str
        SHA-256 of the source file, empty for logs that never were a file.
    recordings : tuple of str
        SHA-256 of each file that the log was joined of.
    contents : tuple of str
        SHA-256 of what each of them holds: the same for a recording that was converted or copied by hand.
    remarks : tuple of str
        What reading had to decide or leave out, a sentence each.
    listed_joints : tuple of str
        Joints in the order that the source lists them in, where the columns were put in another; else empty.
    static : bool
        Poses without a clock, as point-and-measure tables hold them: each row is a motion of its own, `time` and
        `trajectory` are its row number, and there are no velocities.
    """

    time: FloatArray
    trajectory: IntArray
    session: IntArray
    setpoint_cp: PoseSignal | None = None
    measured_cp: PoseSignal | None = None
    tracker_cp: PoseSignal | None = None
    setpoint_jp: FloatArray | None = None
    measured_jp: FloatArray | None = None
    measured_jv: FloatArray | None = None
    measured_jf: FloatArray | None = None
    external_jp: FloatArray | None = None
    payload: FloatArray | None = None
    temperature: FloatArray | None = None
    extra: Mapping[str, FloatArray] = field(default_factory=dict)
    meta: LogMeta = field(default_factory=LogMeta)
    name: str = ""
    digest: str = ""
    recordings: tuple[str, ...] = ()
    contents: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    listed_joints: tuple[str, ...] = ()
    static: bool = False

    POSES = ("setpoint_cp", "measured_cp", "tracker_cp")
    JOINTS = ("setpoint_jp", "measured_jp", "measured_jv", "measured_jf", "external_jp")
    SCALARS = ("payload", "temperature")

    def __post_init__(self) -> None:
        for name, dtype in (("time", np.float64), ("trajectory", np.int64), ("session", np.int64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype))
        for name in (*self.JOINTS, *self.SCALARS):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen_array(value))
        object.__setattr__(self, "extra", {k: frozen_array(v) for k, v in self.extra.items()})
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            if isinstance(value, PoseSignal | np.ndarray) and len(value) != len(self.time):
                raise DataError(f"signal {name} has {len(value)} samples, time has {len(self.time)}.")
        for name in self.JOINTS:
            value = getattr(self, name)
            if value is not None and value.ndim != 2:
                raise DataError(f"signal {name} must have shape (n, dof), got {value.shape}.")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals that are present."""
        return tuple(n for n in (*self.POSES, *self.JOINTS, *self.SCALARS) if getattr(self, n) is not None)

    @property
    def trajectory_ids(self) -> IntArray:
        """Trajectory numbers in the order in which they were recorded."""
        _, first = np.unique(self.trajectory, return_index=True)
        return self.trajectory[np.sort(first)]

    def joint_types(self, dof: int) -> str:
        """Return "R" or "P" for each joint: the sidecar's, or a serial surgical arm's, whose third joint inserts.

        A third joint that goes where no insertion does, but no further than a turn in radians, turns.

        Parameters
        ----------
        dof : int

        Raises
        ------
        LogError
            The sidecar names fewer joints.
        """
        types = self.meta.joint_types
        if not types:
            return ("RRP" + "R" * dof)[:dof] if dof in (3, 6, 7) and not self._turns(2) else "R" * dof
        if len(types) < dof:
            raise LogError(
                f"joint_types {types!r} does not name {dof} joints with R and P.",
                hint="Correct the sidecar.",
                path=self.name,
            )
        return types[:dof]

    def _turns(self, joint: int) -> bool:
        """Whether a joint's positions go further than those of a slide in metres, but no further than a turn."""
        columns = [getattr(self, name)[:, joint] for name in POSITIONS if getattr(self, name) is not None]
        known = [column[np.isfinite(column)] for column in columns if np.isfinite(column).any()]
        ends = np.array([np.percentile(column, REACHED) for column in known]).reshape(-1, 2)
        reach, stroke = np.abs(ends).max(initial=0.0), np.ptp(ends, axis=1).max(initial=0.0)
        return bool((reach > LONGEST_REACH or stroke > LONGEST_STROKE) and reach <= 2 * np.pi)

    def trajectories(self) -> Iterator[tuple[int, IntArray]]:
        """Yield (trajectory number, row indices) in recorded order."""
        order = np.argsort(self.trajectory, kind="stable")
        starts = np.flatnonzero(np.diff(self.trajectory[order])) + 1
        for rows in sorted(np.split(order, starts) if len(order) else [], key=lambda rows: int(rows[0])):
            yield int(self.trajectory[rows[0]]), rows

    def select(self, rows: BoolArray | IntArray | slice) -> CalibrationLog:
        """Return the log of these rows only.

        Parameters
        ----------
        rows : array or slice, flags (n,), row numbers, or a range
        """
        values: dict[str, Any] = {n: getattr(self, n)[rows] for n in ("time", "trajectory", "session", *self.signals)}
        return replace(self, extra={k: v[rows] for k, v in self.extra.items()}, **values)
