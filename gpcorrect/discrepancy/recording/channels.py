"""What a log lets us compare with the simulator: its channels, and the motor side that is replayed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

EVEN = 0.02  # relative spread of the time steps of a clock that a servo loop can be run on


@dataclass(frozen=True)
class Channel:
    """One compared signal.

    Parameters
    ----------
    name : str
        Signal and joint or axis, such as "external_jp_2".
    signal : str
        Log signal; the tracker's orientation counts as one of its own, "tracker_rotation".
    index : int
        Column among the model's joints, or axis of the tracker.
    joint : int
        Number of the joint it speaks of; 0 for the tracker's axes.
    unit : str
        "rad" or "m".
    """

    name: str
    signal: str
    index: int
    joint: int
    unit: str


def joint_columns(log: CalibrationLog, signal: str, joints: tuple[int, ...]) -> FloatArray:
    """Return the columns `(n, k)` of a joint signal for these joint numbers.

    A log with just as many columns has them in this order.

    Parameters
    ----------
    log : CalibrationLog
    signal : str
        Name of the signal.
    joints : tuple of int
        Joint numbers.

    Raises
    ------
    DataError
        The log has neither k columns nor one for each of the numbers.
    """
    values: FloatArray = getattr(log, signal)
    if values.shape[1] == len(joints):
        return values
    if values.shape[1] < max(joints):
        raise DataError(
            f"the model speaks of joints {list(joints)}, {signal} of the log has {values.shape[1]} columns.",
            hint="Name the recorded joints in the model's `joints`.",
        )
    return values[:, [j - 1 for j in joints]]


def motor_side(log: CalibrationLog) -> str:
    """Return the name of the signal that says where the motors were: measured, else commanded.

    Parameters
    ----------
    log : CalibrationLog

    Raises
    ------
    DataError
        The log has neither.
    """
    for name in ("measured_jp", "setpoint_jp"):
        if getattr(log, name) is not None:
            return name
    raise DataError(
        "the log has neither measured_jp nor setpoint_jp: nothing says where the motors were.",
        hint="Log measured_jp (joint positions from the motor encoders) or setpoint_jp.",
    )


def continuous_runs(log: CalibrationLog, motor: FloatArray) -> IntArray:
    """Return the label `(n,)` of the continuous motion each row belongs to.

    Play and hysteresis remember across trajectory numbers.

    Two trajectories of a session are one motion when time and motors `(n, k)` step from one to the next no further than
    they ever do inside a trajectory.

    Parameters
    ----------
    log : CalibrationLog
    motor : (n, k) array
        rad or m.
    """
    change = np.diff(log.trajectory) != 0
    if not change.any():
        return np.zeros(len(log), dtype=np.int64)
    step, moved = np.diff(log.time), np.abs(np.diff(motor, axis=0))
    inside = ~change
    if not inside.any():
        return np.arange(len(log), dtype=np.int64)
    near = (moved <= np.nanmax(moved[inside], axis=0)).all(axis=1)
    joined = (step > 0) & (step <= step[inside].max()) & near & (np.diff(log.session) == 0)
    breaks = change & ~joined
    return np.concatenate([[0], np.cumsum(breaks)]).astype(np.int64)


def sampling_is_even(time: FloatArray, run: IntArray) -> bool:
    """Return whether a servo loop can be run on this clock: all steps inside the runs agree.

    Parameters
    ----------
    time : (n,) array
        s.
    run : (n,) int array
        Continuous motion of each row.
    """
    steps = np.diff(time)[np.diff(run) == 0]
    if len(steps) == 0:
        return False
    return bool(np.abs(steps / np.median(steps) - 1.0).max() < EVEN)


def compared_channels(
    log: CalibrationLog, body: Body, source: str, *, loop: bool
) -> tuple[tuple[Channel, ...], FloatArray]:
    """Return the joint channels that a log lets us compare, and what was measured in them `(n, c)`.

    Parameters
    ----------
    log : CalibrationLog
    body : Body
        Nominal arm.
    source : str
        Signal of the motor side.
    loop : bool
        Whether the closed loop is simulated, so that measured motors can be compared too.

    Raises
    ------
    DataError
        Nothing sees the arm from outside.
    """
    kinematics = body.chain is not None
    if log.external_jp is None and (log.tracker_cp is None or not kinematics):
        raise DataError(
            "the log has no external_jp"
            + ("" if kinematics else ", and a bare joint chain has no kinematics to use tracker_cp with")
            + ("" if log.tracker_cp is not None or not kinematics else " and no tracker_cp")
            + ": nothing says where the arm really was.",
            hint="Log external_jp, or tracker_cp with an arm that has kinematics.",
        )
    channels: list[Channel] = []
    columns: list[FloatArray] = []
    outside = [] if log.external_jp is None else ["external_jp"]
    for signal in ([source] if loop and source == "measured_jp" else []) + outside:
        values = joint_columns(log, signal, body.joints)
        for i, (joint, kind) in enumerate(zip(body.joints, body.types, strict=True)):
            channels.append(Channel(f"{signal}_{joint}", signal, i, joint, "m" if kind == "P" else "rad"))
            columns.append(values[:, i])
    return tuple(channels), np.stack(columns, axis=1) if columns else np.zeros((len(log), 0))


def tracker_channels(n_axes: int) -> tuple[Channel, ...]:
    """Return the channels of a tracker: three positions, and three turns where it has six axes.

    Parameters
    ----------
    n_axes : int
        3 or 6.
    """
    kinds = (("tracker_cp", "m"), ("tracker_rotation", "rad"))
    every = [Channel(f"{signal}_{axis}", signal, i, 0, unit) for signal, unit in kinds for i, axis in enumerate("xyz")]
    return tuple(every[:n_axes])
