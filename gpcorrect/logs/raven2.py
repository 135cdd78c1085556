"""RAVEN-II state messages: both arms in one, in micrometres and degrees, and several traps.

As published by the public `raven2` control software: poses are stored by mechanism, joints by arm (left
first), eight a side with an unused fourth. All joints, the insertion too, are multiplied by 180/pi. `tau` is
what the controller asks of the motors. While the pedal is up the desired pose is a copy of the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.messages import Recorded, Times
from gpcorrect.logs.orientation import CONVERTERS
from gpcorrect.logs.streams import Stream
from gpcorrect.types import FloatArray, LogMeta, PoseSignal

RAVEN_STATE_TYPE = "raven_2/msg/raven_state"  # of the public software
RAVEN_STATE_DEFINITION = """\
std_msgs/Header hdr
int32 runlevel
int32 sublevel
int32 last_seq
int32[2] type
int32[6] pos
float32[18] ori
float32[18] ori_d
int32[6] pos_d
builtin_interfaces/Duration dt
int32[16] encVals
int32[16] dac_val
float32[16] tau
float32[16] mpos
float32[16] jpos
float32[16] mvel
float32[16] jvel
float32[16] mpos_d
float32[16] jpos_d
float32[2] grasp_d
float32[16] encoffsets
float32[12] jac_vel
float32[12] jac_f
"""
"""For recordings that do not carry the definition themselves."""

Arm = Literal["left", "right"]

ARMS: tuple[Arm, Arm] = ("left", "right")
SERIALS: Mapping[Arm, int] = {"left": 24, "right": 10}  # gold and green arm in the public software
FIELDS = {
    "type": 2,
    "runlevel": 1,
    "pos": 6,
    "ori": 18,
    "pos_d": 6,
    "ori_d": 18,
    "tau": 16,
    "jpos": 16,
    "jvel": 16,
    "jpos_d": 16,
}
PEDAL_DOWN = 3  # runlevel of the public software
MICROMETRE = 1e-6  # m
INSERTION = 2  # place of the prismatic joint
LONGEST_INSERTION = 100.0  # 1.7 m times 180/pi: what is beyond it can only be millimetres


def raven_row(message: Any) -> FloatArray:
    """Take the numbers of a message that are used, one after the other.

    Parameters
    ----------
    message : object, raven_state, as the bag's reader decoded it
    """
    missing = [name for name in FIELDS if not hasattr(message, name)]
    if missing:
        raise LogError(f"the raven_state message lacks {', '.join(missing)}.")
    return np.concatenate([np.atleast_1d(getattr(message, name)) for name in FIELDS]).astype(np.float64)


def raven_streams(recorded: Recorded, times: Times, arm: Arm | None) -> tuple[list[Stream], list[str], LogMeta]:
    """Streams of one arm: commanded and reported pose and joints, joint velocities, desired motor torques; and remarks.

    The sixth joint is the wrist's yaw, half the difference of the two jaws, as in the software's kinematics.

    Parameters
    ----------
    recorded, times : messages of a topic, and when they were taken
    arm : {"left", "right"}, optional, the only one there when not given
    """
    ends = np.cumsum(list(FIELDS.values()))
    state = dict(zip(FIELDS, np.split(np.stack(recorded.rows)[times.rows], ends[:-1], axis=1), strict=True))
    side, remarks = _choose_arm(state, arm)
    mechanism, found = _mechanism(state["type"], side)
    measured, setpoint, copies = _poses(state, mechanism)
    remarks = [f"read the {side} arm.", *remarks, *found, *copies]
    scale = np.full(6, np.pi / 180)
    if np.median(np.abs(_side(state["jpos"], side)[:, INSERTION])) > LONGEST_INSERTION:
        scale[INSERTION] = 1e-3
        remarks.append("the insertion was taken to be in millimetres.")
    remarks.append("measured_jf holds the motor torques that the controller asked for (N m), not measured ones.")
    signals: dict[str, PoseSignal | FloatArray] = {
        "measured_cp": measured,
        "setpoint_cp": setpoint,
        "measured_jp": _six(state["jpos"], side, 0.5) * scale,
        "setpoint_jp": _six(state["jpos_d"], side, 0.5) * scale,
        "measured_jv": _six(state["jvel"], side, 0.5) * scale,
        "measured_jf": _six(state["tau"], side, 1.0),
    }
    seen = {name: v for name, v in signals.items() if not isinstance(v, PoseSignal) or v.finite.any()}
    streams = [Stream(name, times.stamp, v, recorded.topic) for name, v in seen.items()]
    return streams, remarks, LogMeta(robot="RAVEN-II", arm=f"raven2_{side}", joint_types="RRPRRR")


def _side(values: FloatArray, arm: Arm) -> FloatArray:
    """Select the eight joints of an arm."""
    start = 8 * ARMS.index(arm)
    return values[:, start : start + 8]


def _six(values: FloatArray, arm: Arm, jaws: float) -> FloatArray:
    """Shoulder, elbow, insertion, roll, wrist, and `jaws` times the second jaw less the first."""
    eight = _side(values, arm)
    return np.column_stack([eight[:, [0, 1, 2, 4, 5]], jaws * (eight[:, 7] - eight[:, 6])])


def _choose_arm(state: Mapping[str, FloatArray], arm: Arm | None) -> tuple[Arm, list[str]]:
    present = [a for a in ARMS if _side(state["jpos"], a).any()]
    if arm is None and len(present) == 1:
        return present[0], []
    if arm is None:
        found = "both arms" if present else "no arm that has a joint position"
        raise LogError(f"the RAVEN-II state holds {found}.", hint="Choose arm 'left' or 'right'.")
    return arm, [] if arm in present else [f"all joint positions of the {arm} arm are zero."]


def _mechanism(types: FloatArray, arm: Arm) -> tuple[int, list[str]]:
    """Place of an arm's pose: where its serial number is, or where the other arm's is not."""
    serials = types[0].astype(int).tolist()
    other = ARMS[1 - ARMS.index(arm)]
    if SERIALS[arm] in serials:
        return serials.index(SERIALS[arm]), []
    if SERIALS[other] in serials:
        return 1 - serials.index(SERIALS[other]), []
    place = ARMS.index(arm)
    return place, [f"the arms have unknown serial numbers {serials}; pose {place} was taken for the {arm} arm."]


def _poses(state: Mapping[str, FloatArray], place: int) -> tuple[PoseSignal, PoseSignal, list[str]]:
    """Measured and desired pose; with the pedal up, a desired pose equal to it is a copy, and so missing."""
    at, turn = slice(3 * place, 3 * place + 3), slice(9 * place, 9 * place + 9)
    position, desired = state["pos"][:, at], state["pos_d"][:, at]
    same = (position == desired).all(axis=1) & (state["ori"][:, turn] == state["ori_d"][:, turn]).all(axis=1)
    copied = same & (state["runlevel"][:, 0] != PEDAL_DOWN)
    measured = PoseSignal(position * MICROMETRE, CONVERTERS["matrix"](state["ori"][:, turn]))
    command = PoseSignal(
        np.where(copied[:, None], np.nan, desired * MICROMETRE),
        np.where(copied[:, None], np.nan, CONVERTERS["matrix"](state["ori_d"][:, turn])),
    )
    remark = f"{copied.sum()} of {len(copied)} desired poses are copies of the measured one (pedal up); missing."
    return measured, command, [remark] if copied.any() else []
