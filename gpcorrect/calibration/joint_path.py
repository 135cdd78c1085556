"""The path of a robot's joints in a log, and its other signals: what features are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.dataset import clocks, path_starts, pause
from gpcorrect.cleaning import CleaningSettings
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

JOINT_SIGNALS = ("setpoint_jp", "measured_jp", "measured_jv", "measured_jf")


@dataclass(frozen=True, eq=False)
class JointPath:
    """n samples of d joints."""

    time: FloatArray  # (n,) s
    new: BoolArray  # (n,) where an unbroken path begins
    q: FloatArray  # (n, d) joints, rad or m; NaN where missing
    velocity: FloatArray  # (n, d) of `q`, from the sample before: what a stream knows too
    effort: FloatArray | None  # (n, d) reported efforts, N m or N
    state: FloatArray | None  # (n, k) all that the log holds of the robot at each moment
    state_names: tuple[str, ...] = ()  # (k,) of its columns


def joint_path(
    time: FloatArray,
    session: IntArray,
    q: FloatArray,
    effort: FloatArray | None,
    state: FloatArray | None = None,
    along: FloatArray | None = None,
) -> JointPath:
    """Return a path with its beginnings and velocities.

    Parameters
    ----------
    time : (n,) array, s
    session : (n,) int array, homing or day
    q : (n, d) array, rad or m
    effort, state : (n, d) and (n, k) arrays or None, as logged
    along : (n, d) array, optional, the path whose velocities count, where it is not that of `q`
    """
    new = path_starts(time, session, np.asarray(np.isfinite(q).all(axis=1)))
    step = np.diff(time, prepend=time[:1])
    going = q if along is None else along
    velocity = np.diff(going, axis=0, prepend=going[:1]) / np.where(step > 0, step, 1.0)[:, None]
    velocity = np.where((new | (step <= 0))[:, None] | ~np.isfinite(velocity), 0.0, velocity)
    return JointPath(time, new, q, velocity, effort, state)


def logged_path(
    log: CalibrationLog,
    q: FloatArray,
    kinds: Sequence[str],
    moving: IntArray | None = None,
    *,
    efforts: bool = True,
    extra: Sequence[str] | None = None,
) -> JointPath:
    """Return the path of joints of a log; in static poses every row is a path of its own, at rest.

    Parameters
    ----------
    log : CalibrationLog, n samples
    q : (n, d) array, all joints, rad or m
    kinds : sequence of str, kinds of features; the whole state is read for "state" only
    moving : (k,) int array, optional, joints that the path is of; all without it
    efforts : bool, whether reported efforts belong to it
    extra : sequence of str, optional, see :func:`state_columns`
    """
    effort = efforts_of(log, q.shape[1], moving) if efforts else None
    names, state = state_columns(log, extra) if "state" in kinds else ((), None)
    path = joint_path(log.time, log.session, q if moving is None else q[:, moving], effort, state)
    path = replace(path, state_names=names)
    if not log.static:
        return path
    return replace(path, new=np.ones(len(log), dtype=bool), velocity=np.zeros(path.q.shape))


def without_faults(log: CalibrationLog, seen: FloatArray, sent: FloatArray, keep: BoolArray) -> FloatArray:
    """Return the path `(n, d)` of an arm that an outside sensor saw, rad or m, without what only the sensor did.

    Where it saw nothing (it is slower than the log, or lost the arm) the arm is taken to be where it was sent, and off
    by what it missed around; over longer than a pause that is unknown. A rejected sample may show where the arm was, as
    at a stop. It is the sensor's where the error left what it is around by more than an arm that stands still, or
    springs back, makes of the commanded travel. Trajectories without any kept sample are left out for another reason,
    and stay as they are.

    Parameters
    ----------
    log : CalibrationLog, n samples
    seen, sent : (n, d) arrays, joints as the sensor saw them, and as they were sent or reported
    keep : (n,) mask, samples that are not rejected
    """
    told = np.isfinite(sent).all(axis=1) & np.isin(log.trajectory, np.unique(log.trajectory[keep]))
    known = np.asarray(np.isfinite(seen).all(axis=1) & np.isfinite(sent).all(axis=1))
    lost = told & ~(known & keep)
    if not lost.any():
        return seen
    clock, path, missed = clocks(log.time, log.session), seen.copy(), seen - sent
    size = np.maximum(np.ptp(sent[known], axis=0), np.finfo(float).tiny)
    longest, follow = pause(np.diff(log.time)), CleaningSettings().follow_factor
    for number in np.unique(clock[lost]):
        rows, good = (np.flatnonzero(mask & (clock == number)) for mask in (lost, known & ~lost))
        if not good.size:
            continue
        place = np.searchsorted(good, rows)
        before, after = good[np.maximum(place - 1, 0)], good[np.minimum(place, len(good) - 1)]
        usual = np.stack([np.interp(log.time[rows], log.time[good], column) for column in missed[good].T], axis=1)
        left, came, went = (
            np.linalg.norm(change / size, axis=1)
            for change in (missed[rows] - usual, sent[rows] - sent[before], sent[after] - sent[rows])
        )
        brief = (log.time[after] - log.time[before] <= longest)[:, None]
        fault = ~(left <= follow * np.maximum(came, went))[:, None]  # also where nothing was seen
        path[rows] = np.where(fault, np.where(brief, sent[rows] + usual, np.nan), seen[rows])
    return path


def usual_steps(path: JointPath) -> tuple[float, float]:
    """Return the usual and the shortest step between samples of a path, s; 1 where there are none.

    Parameters
    ----------
    path : JointPath, n samples
    """
    step = np.diff(path.time)[~path.new[1:]]
    return (float(np.median(step)), float(np.percentile(step, 1))) if step.size else (1.0, 1.0)


def state_columns(log: CalibrationLog, extra: Sequence[str] | None = None) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names `(k,)` and values `(n, k)` of a log's whole state.

    Joint signals come first, then how far the joints are from where they were sent, then poses as position and rotation
    matrix (which never jumps), then scalars and extra columns. Peng et al. 2020 take 118 or 138 numbers of RAVEN-II's
    own message; a native log has 54 for six joints, and what extra columns are asked for.

    Parameters
    ----------
    log : CalibrationLog, n samples
    extra : sequence of str, optional, extra columns that belong to the state; all complete ones when None
    """
    parts: list[tuple[str, FloatArray | None]] = [(name, getattr(log, name)) for name in JOINT_SIGNALS]
    if log.setpoint_jp is not None and log.measured_jp is not None:
        parts.append(("joint_lag", log.setpoint_jp - log.measured_jp))
    parts += [(name, _pose_numbers(getattr(log, name))) for name in ("setpoint_cp", "measured_cp")]
    if extra is None:
        parts += [(name, getattr(log, name)) for name in log.SCALARS]
        extra = [name for name, values in log.extra.items() if np.isfinite(values).all()]
    for name in extra:
        if name not in log.extra:
            raise LogError(f"the log has no column {name}.", hint=f"It has: {', '.join(log.extra) or 'none'}.")
        parts.append((name, log.extra[name]))
    columns = [(name, values.reshape(len(log), -1)) for name, values in parts if values is not None]
    names = tuple(f"{name}_{i + 1}" for name, values in columns for i in range(values.shape[1]))
    return names, np.hstack([values for _, values in columns]) if columns else np.zeros((len(log), 0))


def efforts_of(log: CalibrationLog, dof: int, moving: IntArray | None = None) -> FloatArray | None:
    """Return the efforts `(n, k)` of k joints of a log; None where it has none.

    Parameters
    ----------
    log : CalibrationLog, n samples
    dof : int, joints that go in
    moving : (k,) int array, optional, those that are asked for; all without it

    Raises
    ------
    LogError
        There are more or fewer efforts than joints, so that none is known to be which joint's.
    """
    effort = log.measured_jf
    if effort is not None and effort.shape[1] != dof:
        raise LogError(
            f"measured_jf has {effort.shape[1]} joints, the positions have {dof}.",
            hint="Name the same joints in both: a mapping file given with --columns says which columns are which.",
            path=log.name,
        )
    return effort if effort is None or moving is None else effort[:, moving]


def effort_kind(log: CalibrationLog, dof: int, moving: IntArray | None = None) -> tuple[str, ...]:
    """Return the feature of efforts where they are complete in most samples: the others cannot be learned from.

    Parameters
    ----------
    log, dof, moving
        As for :func:`efforts_of`.
    """
    effort = efforts_of(log, dof, moving)
    return () if effort is None or 2 * np.isfinite(effort).all(axis=1).sum() <= len(log) else ("effort",)


def refuse_other_columns(names: Sequence[str], expected: Sequence[str]) -> None:
    """Refuse a whole state of other columns than a model learned from: by their number alone one would be another.

    Parameters
    ----------
    names : sequence of str, of the state that came
    expected : sequence of str, of the training's

    Raises
    ------
    DataError
        They differ; which are missing and which are new is said.
    """
    if tuple(names) != tuple(expected):
        missing, new = [n for n in expected if n not in names], [n for n in names if n not in expected]
        raise DataError(
            f"the state has other columns than the model was trained with; missing: {', '.join(missing) or 'none'}; "
            f"new: {', '.join(new) or 'none'}.",
            hint="Hand over the signals of the training log, and no others.",
        )


def _pose_numbers(signal: PoseSignal | None) -> FloatArray | None:
    if signal is None or signal.quaternion is None:
        return None if signal is None else signal.position
    R = se3.matrix_from_quaternion(signal.quaternion)
    return np.hstack([signal.position, R.reshape(len(signal), 9)])
