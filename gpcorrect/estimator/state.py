"""The robot's state as numbers: everything that a robot says of itself at one moment, in a fixed order.

Peng et al. 2020 take 118 or 138 numbers of RAVEN-II's own message. A native log holds what every robot has: commanded
and reported joints and poses, velocities and efforts; 54 numbers for six joints, and what extra columns are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["RobotState", "state_columns"]

JOINT_SIGNALS = ("setpoint_jp", "measured_jp", "measured_jv", "measured_jf")
POSE_SIGNALS = ("setpoint_cp", "measured_cp")


@dataclass(frozen=True, eq=False)
class RobotState:
    """One moment of the robot's state, as a stream hands it over.

    Parameters
    ----------
    time : float
        s.
    measured_jp : (d,) array
        Reported joints, rad or m.
    measured_position : (3,) array
        Reported position of the tool, base frame, m.
    measured_quaternion : (4,) array or None
        Reported orientation wxyz.
    setpoint_jp, measured_jv, measured_jf : (d,) arrays or None
        Commanded joints, velocities, efforts.
    setpoint_position, setpoint_quaternion : arrays or None
        Commanded pose.
    extra : sequence of float
        The extra columns that the model was trained with, in its order.
    """

    time: float
    measured_jp: FloatArray
    measured_position: FloatArray
    measured_quaternion: FloatArray | None = None
    setpoint_jp: FloatArray | None = None
    measured_jv: FloatArray | None = None
    measured_jf: FloatArray | None = None
    setpoint_position: FloatArray | None = None
    setpoint_quaternion: FloatArray | None = None
    extra: Sequence[float] = ()


def state_columns(log: CalibrationLog, extra: Sequence[str] = ()) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names `(k,)` and values `(n, k)` of a log's whole state.

    Joint signals come first, then how far the joints are from where they were sent, then poses as position and rotation
    matrix (which never jumps), then `extra` columns.

    Raises
    ------
    LogError
        An extra column is not in the log.
    """
    names: list[str] = []
    parts: list[FloatArray] = []
    for name in JOINT_SIGNALS:
        _add(names, parts, name, getattr(log, name))
    if log.setpoint_jp is not None and log.measured_jp is not None:
        _add(names, parts, "joint_lag", log.setpoint_jp - log.measured_jp)
    for name in POSE_SIGNALS:
        _add(names, parts, name, _pose_numbers(getattr(log, name)))
    for name in extra:
        if name not in log.extra:
            raise LogError(f"the log has no column {name}.", hint=f"It has: {', '.join(log.extra) or 'none'}.")
        _add(names, parts, name, log.extra[name][:, None])
    return tuple(names), np.hstack(parts) if parts else np.zeros((len(log), 0))


def _add(names: list[str], parts: list[FloatArray], name: str, values: FloatArray | None) -> None:
    if values is None:
        return
    names.extend(f"{name}_{i + 1}" for i in range(values.shape[1]))
    parts.append(values)


def _pose_numbers(signal: PoseSignal | None) -> FloatArray | None:
    if signal is None:
        return None
    if signal.quaternion is None:
        return signal.position
    R = se3.matrix_from_quaternion(signal.quaternion)
    return np.hstack([signal.position, R.reshape(len(signal), 9)])
