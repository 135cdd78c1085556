"""ROS messages to streams: poses and joint states, header stamps and receive times."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.orientation import unit_quaternions
from gpcorrect.logs.streams import Stream
from gpcorrect.types import FloatArray, IntArray, PoseSignal

NO_ROTATION = (math.nan,) * 4  # of a point

# Signals in a JointState, in the order of its fields.
JOINT_SIGNALS = {
    "measured_js": ("measured_jp", "measured_jv", "measured_jf"),
    "setpoint_js": ("setpoint_jp",),
    "external_js": ("external_jp",),
}


@dataclass
class Recorded:
    """The messages of one topic while a recording is read; times in ns since 1970."""

    topic: str
    extract: Callable[[Any], Any]  # takes what is needed out of a message; the message itself is not stored
    stamp: list[int] = field(default_factory=list)
    receive: list[int] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)

    def add(self, message: Any, receive: int) -> None:
        """Append a message.

        Parameters
        ----------
        message : object, as the bag's reader decoded it
        receive : int, when it was received, ns since 1970
        """
        header = getattr(message, "hdr", None) or getattr(message, "header", None)
        self.stamp.append(0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec)
        self.receive.append(receive)
        self.rows.append(self.extract(message))


def pose_row(message: Any) -> tuple[float, ...]:
    """Position and quaternion wxyz of a message; NaN for the quaternion of a point.

    Parameters
    ----------
    message : object
        Pose, PoseStamped, PoseWithCovarianceStamped, Odometry, TransformStamped or PointStamped.
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


def array_row(place: int | None) -> Callable[[Any], tuple[float, ...]]:
    """Make a function that takes one pose out of a PoseArray; NaN where the array is too short.

    Parameters
    ----------
    place : int or None, which one, counted from 0; None for the only one
    """

    def _row(message: Any) -> tuple[float, ...]:
        count, k = len(message.poses), place or 0
        if place is None and count > 1:
            raise LogError(f"an array holds {count} poses.", hint="Choose one by its place, counted from 0: /poses[1].")
        return pose_row(message.poses[k]) if k < count else (math.nan,) * 3 + NO_ROTATION

    return _row


def joint_row(message: Any) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
    """Names, positions, velocities and efforts of a message.

    Parameters
    ----------
    message : object, JointState
    """
    return tuple(message.name), message.position, message.velocity, message.effort


@dataclass(frozen=True, eq=False)
class Times:
    """When the usable messages of a topic were taken (s after the origin), and which they are."""

    stamp: FloatArray
    rows: IntArray
    remarks: Sequence[str]

    @classmethod
    def of(cls, recorded: Recorded, origin: int, clock: Literal["header", "receive"]) -> Times:
        """Header stamps, or receive times where the source left its stamps zero.

        Parameters
        ----------
        recorded : Recorded, messages of a topic
        origin : int, time that becomes zero, ns since 1970; the same for all topics of a recording
        clock : {"header", "receive"}, which times to take
        """
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
        return cls((stamp[rows] - origin) / 1e9, rows, remarks)


def pose_streams(name: str, recorded: Recorded, times: Times) -> tuple[list[Stream], list[str]]:
    """Stream of poses; a quaternion that is none becomes missing, and a remark says how many.

    Parameters
    ----------
    name : str
    recorded, times : messages of a topic, and when they were taken
    """
    table = np.array(recorded.rows, dtype=np.float64)[times.rows]
    quaternion = unit_quaternions(table[:, 3:])
    bad = int((np.isfinite(table[:, 3:]).all(axis=1) & np.isnan(quaternion).any(axis=1)).sum())
    remarks = [f"{bad} samples of {name} have no valid rotation; it counts as missing."] if bad else []
    pose = PoseSignal(table[:, :3], None if np.isnan(table[:, 3:]).all() else quaternion)
    return [Stream(name, times.stamp, pose, recorded.topic)], remarks


def in_one_order(recorded: Mapping[str, Recorded]) -> tuple[dict[str, Recorded], tuple[str, ...]]:
    """Give the joints of all joint states the order that the first topic names them in; and remarks on it.

    Parameters
    ----------
    recorded : mapping of str to Recorded
    """
    ordered, remarks, order, first = dict(recorded), [], None, ""
    for kind in JOINT_SIGNALS:
        if kind not in recorded:
            continue
        one = recorded[kind]
        names = one.rows[0][0]
        if len(set(names)) < max(len(names), 1):  # without names, or with the same twice, none is known
            continue
        if order is None:
            order, first = names, one.topic
        elif any(name in order and order.index(name) != place for place, name in enumerate(names)):
            if sorted(names) != sorted(order):
                raise LogError(f"{first} holds the joints {', '.join(order)}, and {one.topic} {', '.join(names)}.")
            ordered[kind] = replace(one, rows=[_moved(row, names, order) for row in one.rows])
            remarks.append(f"{one.topic} names its joints in another order than {first}: that of {first} was taken.")
    return ordered, tuple(remarks)


def _moved(row: tuple[Any, ...], names: tuple[str, ...], order: tuple[str, ...]) -> tuple[Any, ...]:
    if row[0] != names:
        return row  # refused later: the joints change from message to message
    places = [names.index(name) for name in order]
    return (order, *(part[places] if len(part) == len(names) else part for part in row[1:]))


def joint_streams(name: str, recorded: Recorded, times: Times) -> tuple[list[Stream], list[str]]:
    """Streams of joint positions, and of measured velocities and efforts where they were published; and remarks.

    Parameters
    ----------
    name : str, CRTK name of the topic, such as "measured_js"
    recorded, times : messages of a topic, and when they were taken
    """
    if len({row[0] for row in recorded.rows}) > 1:
        raise LogError(f"the joints of {recorded.topic} change from message to message.")
    names = JOINT_SIGNALS[name]
    streams, remarks = [], []
    for k, signal in enumerate(names, start=1):
        widths = {len(recorded.rows[i][k]) for i in times.rows}
        if len(widths) > 1:
            remarks.append(f"{signal} is left out: {recorded.topic} holds {sorted(widths)} numbers in turn.")
        elif widths - {0}:
            values = np.array([recorded.rows[i][k] for i in times.rows], dtype=np.float64)
            streams.append(Stream(signal, times.stamp, values, recorded.topic))
    return streams, remarks
