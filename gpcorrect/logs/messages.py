"""ROS messages to streams: poses, joint states and RAVEN-II states, header stamps and receive times.

RAVEN-II state messages, as published by the public `raven2` control software, hold both arms, in micrometres and
degrees, and several traps: poses are stored by mechanism, joints by arm (left first), eight a side with an unused
fourth. All joints, the insertion too, are multiplied by 180/pi. `tau` is what the controller asks of the motors. While
the pedal is up the desired pose is a copy of the measured one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.order import by_stamp
from gpcorrect.logs.orientation import CONVERTERS, quaternions_of
from gpcorrect.logs.streams import Stream
from gpcorrect.types import FloatArray, IntArray, LogMeta, PoseSignal

NO_ROTATION = (math.nan,) * 4  # of a point

# Signals in a JointState, in the order of its fields.
JOINT_SIGNALS = {
    "measured_js": ("measured_jp", "measured_jv", "measured_jf"),
    "setpoint_js": ("setpoint_jp",),
    "external_js": ("external_jp",),
}
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
FIELDS = ("type", "runlevel", "pos", "ori", "pos_d", "ori_d", "tau", "jpos", "jvel", "jpos_d")
PEDAL_DOWN = 3  # runlevel of the public software
MICROMETRE = 1e-6  # m
INSERTION = 2  # place of the prismatic joint
LONGEST_INSERTION = 100.0  # 1.7 m times 180/pi: what is beyond it can only be millimetres


@dataclass
class Recorded:
    """The messages of one topic while a recording is read; times in ns since 1970."""

    topic: str
    extract: Callable[[Any], Any]  # takes what is needed out of a message; the message itself is not stored
    stamp: list[int] = field(default_factory=list)
    receive: list[int] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)
    # frames that messages are in and bodies that they are of, without slashes; empty where a message has none
    frames: set[tuple[str, str]] = field(default_factory=set)

    def add(self, message: Any, receive: int) -> None:
        """Append a message.

        Parameters
        ----------
        message : object, as the bag's reader decoded it
        receive : int, when it was received, ns since 1970
        """
        header = getattr(message, "hdr", None) or getattr(message, "header", None)
        self.stamp.append(0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec)
        frame, body = getattr(header, "frame_id", ""), getattr(message, "child_frame_id", "")
        self.frames.add((frame.strip("/"), body.strip("/")))
        self.receive.append(receive)
        self.rows.append(self.extract(message))


def pose_row(message: Any) -> tuple[float, ...]:
    """Position and quaternion wxyz of a message; NaN for the quaternion of a point.

    Parameters
    ----------
    message : object, Pose, PoseStamped, PoseWithCovarianceStamped, Odometry, TransformStamped or PointStamped
    """
    if hasattr(message, "point"):
        return message.point.x, message.point.y, message.point.z, *NO_ROTATION
    if hasattr(message, "transform"):
        p, q = message.transform.translation, message.transform.rotation
    else:
        pose = getattr(message, "pose", message)
        pose = getattr(pose, "pose", pose)  # inside the one with a covariance
        p, q = pose.position, pose.orientation
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


def extractor(kind: str, msgtype: str, place: int | None) -> Callable[[Any], Any]:
    """Return what takes out of a message what is needed of it.

    Parameters
    ----------
    kind : str, signal of a pose, CRTK name of a joint state, such as "measured_js", or "raven_state"
    msgtype : str, type of message
    place : int or None, which pose of an array, counted from 0; None for the only one
    """
    if kind == "raven_state":
        return _raven_row
    if kind.endswith("_js"):
        return lambda message: (tuple(message.name), message.position, message.velocity, message.effort)

    def _of_array(message: Any) -> tuple[float, ...]:
        """Take one pose out of a PoseArray; NaN where the array is too short."""
        count, k = len(message.poses), place or 0
        if place is None and count > 1:
            hint = "Choose one by its place, counted from 0: --tracker-topic '/poses[1]', or so under [bag.topics]."
            raise LogError(f"an array holds {count} poses.", hint=hint)
        return pose_row(message.poses[k]) if k < count else (math.nan,) * 3 + NO_ROTATION

    return _of_array if msgtype.endswith("/PoseArray") else pose_row


def streams_of(
    kind: str, recorded: Recorded, origin: int, clock: Literal["header", "receive"], arm: Arm | None
) -> tuple[list[Stream], list[str], LogMeta | None]:
    """Streams of the messages of a topic, remarks, and what they say of the robot.

    Parameters
    ----------
    kind : str, see :func:`extractor`
    recorded : Recorded, messages of a topic
    origin : int, time that becomes zero, ns since 1970; the same for all topics of a recording
    clock : {"header", "receive"}
        Which times to take; receive times also where the source left its header stamps zero.
    arm : {"left", "right"}, optional, which arm of RAVEN-II states; the only one there when not given
    """
    stamp, rows, remarks = _times(recorded, origin, clock)
    meta = None
    if kind == "raven_state":
        streams, found, meta = _raven_streams(recorded, stamp, rows, arm)
    else:
        streams, found = (_joint_streams if kind.endswith("_js") else _pose_streams)(kind, recorded, stamp, rows)
    return streams, [*remarks, *found], meta


def _times(recorded: Recorded, origin: int, clock: str) -> tuple[FloatArray, IntArray, list[str]]:
    """When the usable messages were taken (s after the origin), which they are, and remarks."""
    stamp, receive = np.array(recorded.stamp, np.int64), np.array(recorded.receive, np.int64)
    rows, remarks = np.arange(len(stamp)), []
    if clock == "receive":
        stamp = receive
    elif not stamp.any():
        stamp = receive
        remarks = [f"{recorded.topic} has no header stamps; the receive times were taken."]
    elif not stamp.all():
        rows = np.flatnonzero(stamp)
        remarks = [f"{len(stamp) - len(rows)} messages of {recorded.topic} without a stamp were left out."]
    seconds = (stamp[rows] - origin) / 1e9
    order = by_stamp(seconds)
    late = int((seconds < np.maximum.accumulate(seconds)).sum())
    if np.any(np.diff(order) < 0):
        what = f"{late} messages of {recorded.topic} were received out of order"
        remarks = [*remarks, f"{what}; they are sorted by their stamps."]
    return seconds[order], rows[order], remarks


def _pose_streams(name: str, recorded: Recorded, stamp: FloatArray, rows: IntArray) -> tuple[list[Stream], list[str]]:
    """Stream of poses; a quaternion that is none becomes missing, and a remark says how many."""
    for names in zip(*recorded.frames, strict=True):
        if len(held := sorted({*names} - {""})) < 2:
            continue
        hint = "Record each body under a topic of its own."
        raise LogError(
            f"{recorded.topic} holds poses of several bodies or in several frames: {', '.join(held)}.", hint=hint
        )
    table = np.array(recorded.rows, dtype=np.float64)[rows]
    quaternion, remarks = quaternions_of(name, "quat_wxyz", table[:, 3:])
    pose = PoseSignal(table[:, :3], None if np.isnan(table[:, 3:]).all() else quaternion)
    return [Stream(name, stamp, pose, recorded.topic)], remarks


def in_one_order(recorded: Mapping[str, Recorded]) -> tuple[dict[str, Recorded], tuple[str, ...], tuple[str, ...]]:
    """Give the joints of all joint states the order of the first message of the first topic; their names, and remarks.

    Parameters
    ----------
    recorded : mapping of str to Recorded
    """
    ordered, remarks, order, first = dict(recorded), list[str](), tuple[str, ...](), ""
    for kind in JOINT_SIGNALS:
        if kind not in recorded:
            continue
        one = recorded[kind]
        names = one.rows[0][0]
        if len(set(names) - {""}) < max(len(names), 1):  # without names, or with the same twice, none is known
            continue
        if any(row[0] != names and sorted(row[0]) == sorted(names) for row in one.rows):
            remarks.append(f"{one.topic} names its joints in changing order: that of its first message was taken.")
            ordered[kind] = one = replace(one, rows=[_moved(row, names) for row in one.rows])
        if names[: len(order)] == order:  # the first, or with more joints behind the others
            order, first = names, first or one.topic
        elif any(name in order and order.index(name) != place for place, name in enumerate(names)):
            if sorted(names) != sorted(order):
                raise LogError(f"{first} holds the joints {', '.join(order)}, and {one.topic} {', '.join(names)}.")
            ordered[kind] = replace(one, rows=[_moved(row, order) for row in one.rows])
            remarks.append(f"{one.topic} names its joints in another order than {first}: that of {first} was taken.")
    return ordered, order, tuple(remarks)


def _moved(row: tuple[Any, ...], order: tuple[str, ...]) -> tuple[Any, ...]:
    if row[0] == order or sorted(row[0]) != sorted(order):
        return row  # other joints are refused later: they change from message to message
    places = [row[0].index(name) for name in order]
    return (order, *(part[places] if len(part) == len(order) else part for part in row[1:]))


def _joint_streams(name: str, recorded: Recorded, stamp: FloatArray, rows: IntArray) -> tuple[list[Stream], list[str]]:
    """Streams of joint positions, and of measured velocities and efforts where they were published; and remarks."""
    named = list(dict.fromkeys(row[0] for row in recorded.rows))
    if len(named) > 1:
        found = " and then ".join(", ".join(row) or "none" for row in named[:2])
        raise LogError(
            f"the joints of {recorded.topic} change from message to message: it names {found}.",
            hint="Only their order may change. Record each part of the robot under a topic of its own.",
        )
    names = JOINT_SIGNALS[name]
    streams, remarks = [], []
    for k, signal in enumerate(names, start=1):
        widths = {len(recorded.rows[i][k]) for i in rows}
        if len(widths) > 1:
            remarks.append(f"{signal} is left out: {recorded.topic} holds {sorted(widths)} numbers in turn.")
        elif widths - {0}:
            values = np.array([recorded.rows[i][k] for i in rows], dtype=np.float64)
            streams.append(Stream(signal, stamp, values, recorded.topic))
    return streams, remarks


def _raven_row(message: Any) -> tuple[FloatArray, ...]:
    """Take the fields of a raven_state message that are used."""
    missing = [name for name in FIELDS if not hasattr(message, name)]
    if missing:
        raise LogError(f"the raven_state message lacks {', '.join(missing)}.")
    return tuple(np.array(getattr(message, name), dtype=np.float64, ndmin=1) for name in FIELDS)


def _raven_streams(
    recorded: Recorded, stamp: FloatArray, rows: IntArray, arm: Arm | None
) -> tuple[list[Stream], list[str], LogMeta]:
    """Streams of one arm: commanded and reported pose and joints, joint velocities, desired motor torques; and remarks.

    The sixth joint is the wrist's yaw, half the difference of the two jaws, as in the software's kinematics.
    """
    state = {name: np.stack([recorded.rows[i][k] for i in rows]) for k, name in enumerate(FIELDS)}
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
    streams = [Stream(name, stamp, v, recorded.topic) for name, v in seen.items()]
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
        raise LogError(f"the RAVEN-II state holds {found}.", hint="Choose --arm left or right (in Python arm).")
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
