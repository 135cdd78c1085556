"""The path of a robot's joints in a log, and its other signals: what features are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.dataset import path_starts
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


def joint_path(
    time: FloatArray, session: IntArray, q: FloatArray, effort: FloatArray | None, state: FloatArray | None = None
) -> JointPath:
    """Return a path with its beginnings and velocities.

    Parameters
    ----------
    time : (n,) array, s
    session : (n,) int array, homing or day
    q : (n, d) array, rad or m
    effort, state : (n, d) and (n, k) arrays or None, as logged
    """
    new = path_starts(time, session, np.asarray(np.isfinite(q).all(axis=1)))
    step = np.diff(time, prepend=time[:1])
    velocity = np.diff(q, axis=0, prepend=q[:1]) / np.where(step > 0, step, 1.0)[:, None]
    velocity = np.where((new | (step <= 0))[:, None] | ~np.isfinite(velocity), 0.0, velocity)
    return JointPath(time, new, q, velocity, effort, state)


def logged_path(log: CalibrationLog, q: FloatArray, effort: FloatArray | None, state: FloatArray | None) -> JointPath:
    """Return the path of joints of a log; in static poses every row is a path of its own, at rest.

    Parameters
    ----------
    log : CalibrationLog, n samples
    q, effort, state : (n, d), (n, d) and (n, k) arrays, see :func:`joint_path`
    """
    path = joint_path(log.time, log.session, q, effort, state)
    if not log.static:
        return path
    return replace(path, new=np.ones(len(log), dtype=bool), velocity=np.zeros(path.q.shape))


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
