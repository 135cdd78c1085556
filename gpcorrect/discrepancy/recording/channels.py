"""What a log lets us compare with the simulator: its channels, and what was measured in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.types import CalibrationLog, FloatArray


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
    """Return the columns `(n, k)` of a joint signal for these joint numbers, in whose order just k columns stand.

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
    signals = ["measured_jp"] if loop and source == "measured_jp" else []
    signals += [] if log.external_jp is None else ["external_jp"]
    units = ["m" if kind == "P" else "rad" for kind in body.types]
    channels = tuple(
        Channel(f"{signal}_{joint}", signal, i, joint, unit)
        for signal in signals
        for i, (joint, unit) in enumerate(zip(body.joints, units, strict=True))
    )
    observed = [joint_columns(log, signal, body.joints) for signal in signals]
    return channels, np.concatenate([np.zeros((len(log), 0)), *observed], axis=1)


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
