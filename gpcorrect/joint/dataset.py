"""From a log to what a joint calibration learns from: input path, errors, efforts, and where paths begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from gpcorrect.errors import DegenerateError, LogError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

__all__ = ["Direction", "InputSignal", "JointData", "check_moves", "joint_data"]

InputSignal = Literal["measured_jp", "setpoint_jp"]
Direction = Literal["estimate", "command"]

GAP_STEPS = 20.0  # a pause this many times the median step: the arm may have moved unseen
MOST_PRISMATIC = 2.0  # m: no arm inserts further, so such a number is in millimetres
MOST_REVOLUTE = 20.0  # rad: over three turns, so such a number is in degrees
LEAST_MOTION = {"R": 1e-5, "P": 1e-6}  # rad and m: less is noise of the encoder


@dataclass(frozen=True, eq=False)
class JointData:
    """A log as joint calibration sees it, n samples of d joints.

    Parameters
    ----------
    time : (n,) array
        s.
    trajectory, session : (n,) int arrays
        As in the log.
    new : (n,) bool array
        Where a path begins: nothing is known of what the arm did before.
    q : (n, d) array
        What goes in: reported positions (estimate), or desired true ones (command); rad or m.
    truth : (n, d) array or None
        What is to come out; NaN where missing; None in a log to be corrected only.
    velocity : (n, d) array
        Of `q`, from the sample before: what a stream knows too.
    effort : (n, d) array or None
        Reported efforts, N m or N.
    state : (n, k) array or None
        Everything else that the log says of the robot at each moment.
    types : str
        "R" or "P" for each joint.
    """

    time: FloatArray
    trajectory: IntArray
    session: IntArray
    new: BoolArray
    q: FloatArray
    truth: FloatArray | None
    velocity: FloatArray
    effort: FloatArray | None
    state: FloatArray | None
    types: str

    def __len__(self) -> int:
        return len(self.time)

    @property
    def usable(self) -> BoolArray:
        """(n,) mask of samples with input and truth."""
        mask: BoolArray = np.asarray(np.isfinite(self.q).all(axis=1))
        return mask if self.truth is None else mask & np.isfinite(self.truth).all(axis=1)

    @property
    def error(self) -> FloatArray:
        """(n, d) what is to be added to the input: truth minus input.

        Raises
        ------
        LogError
            The log knows no truth.
        """
        if self.truth is None:
            raise LogError("the log has no external_jp to compare with.", hint="Record the outside encoders too.")
        return self.truth - self.q


def joint_data(
    log: CalibrationLog,
    input_signal: InputSignal | None = None,
    direction: Direction = "estimate",
    *,
    needs_truth: bool = True,
) -> JointData:
    """Take out of a log what joint calibration needs.

    Parameters
    ----------
    log : CalibrationLog
        Holds `external_jp`, and `measured_jp` or `setpoint_jp`.
    input_signal : str, optional
        Which of the two; the reported positions where logged, else the commanded ones.
    direction : "estimate" or "command"
        From reported to true, or from desired true positions to what to command.
    needs_truth : bool
        Whether the signal to learn must be there.

    Raises
    ------
    LogError
        A signal is missing, its joints do not match, or its unit cannot be right.
    """
    name = input_signal or ("measured_jp" if log.measured_jp is not None else "setpoint_jp")
    if name not in get_args(InputSignal):
        raise LogError(f"the input is one of {', '.join(get_args(InputSignal))}; got {name!r}.", path=log.name)
    reported = _signal(log, name)
    true = _signal(log, "external_jp") if needs_truth or direction == "command" else log.external_jp
    if true is not None and true.shape != reported.shape:
        raise LogError(
            f"{name} has {reported.shape[1]} joints, external_jp {true.shape[1]}.",
            hint="Name the same joints in both: a mapping file given with --columns says which columns are which.",
            path=log.name,
        )
    types = log.joint_types(reported.shape[1])
    for signal, values in ((name, reported), ("external_jp", true)):
        if values is not None:
            _check_units(log, signal, values, types)
    q, truth = (reported, true) if direction == "estimate" else (_required(true), reported)
    new = _beginnings(log, q)
    effort = log.measured_jf if direction == "estimate" else None
    return JointData(
        time=log.time,
        trajectory=log.trajectory,
        session=log.session,
        new=new,
        q=q,
        truth=truth,
        velocity=_backward(log.time, q, new),
        effort=effort,
        state=_state(log),
        types=types,
    )


def check_moves(data: JointData, rows: IntArray) -> None:
    """Refuse training data in which a joint never moves.

    Raises
    ------
    DegenerateError
        One does not; the message names it.
    """
    for joint, kind in enumerate(data.types):
        if np.ptp(data.q[rows, joint]) < LEAST_MOTION[kind]:
            raise DegenerateError(
                f"joint {joint + 1} never moves in the training data: its error cannot be learned.",
                hint="Record motion of every joint, or leave its columns out. See: gpcorrect zigzag --help",
            )


def _signal(log: CalibrationLog, name: str) -> FloatArray:
    value: FloatArray | None = getattr(log, name)
    if value is None:
        raise LogError(
            f"joint calibration needs {name}; the log has {', '.join(log.signals) or 'no signals'}.",
            hint="Map its columns: --columns map.toml",
            path=log.name,
        )
    return value


def _required(value: FloatArray | None) -> FloatArray:
    if value is None:
        raise LogError("commands need external_jp as their input.")
    return value


def _check_units(log: CalibrationLog, signal: str, values: FloatArray, types: str) -> None:
    for joint, kind in enumerate(types):
        most, unit, other = (MOST_PRISMATIC, "m", "mm") if kind == "P" else (MOST_REVOLUTE, "rad", "degrees")
        typical = float(np.nanmedian(np.abs(values[:, joint]))) if np.isfinite(values[:, joint]).any() else 0.0
        if typical > most:
            raise LogError(
                f"joint {joint + 1} of {signal} is typically {typical:.4g}, too much for {unit}: is it in {other}?",
                hint="Logs hold rad and m; give scale in a mapping file, or joint_types in the sidecar.",
                path=log.name,
            )


def _beginnings(log: CalibrationLog, q: FloatArray) -> BoolArray:
    """Where paths begin: after a pause, a homing or a gap.

    Trajectories that follow each other without a pause are one path: what the arm did before still counts.
    """
    step = np.diff(log.time, prepend=log.time[0] if len(log) else 0.0)
    typical = float(np.median(step[1:])) if len(step) > 1 else 0.0
    known = np.asarray(np.isfinite(q).all(axis=1))
    apart = (step > GAP_STEPS * typical) | (step < 0)
    homed = np.diff(log.session, prepend=log.session[:1]) != 0
    before = np.concatenate([[False], known])[:-1]
    new: BoolArray = np.asarray(apart | homed | ~known | ~before)
    return new


def _backward(time: FloatArray, q: FloatArray, new: BoolArray) -> FloatArray:
    """Velocity from the sample before; 0 where a path begins."""
    step = np.diff(time, prepend=time[:1])
    velocity = np.diff(q, axis=0, prepend=q[:1]) / np.where(step > 0, step, 1.0)[:, None]
    return np.where((new | (step <= 0))[:, None] | ~np.isfinite(velocity), 0.0, velocity)


def _state(log: CalibrationLog) -> FloatArray | None:
    """Everything a log says of the robot itself, constant columns and gaps left out."""
    names = ("setpoint_jp", "measured_jp", "measured_jv", "measured_jf", "payload", "temperature")
    parts = [getattr(log, name) for name in names]
    columns = [part.reshape(len(log), -1) for part in parts if part is not None]
    columns += [np.asarray(v)[:, None] for v in log.extra.values()]
    columns = [c[:, np.isfinite(c).all(axis=0)] for c in columns]
    state = np.hstack(columns) if columns else np.zeros((len(log), 0))
    return state if state.shape[1] else None
