"""The same messages for ROS 2, in CDR."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from gpcorrect_service.crtk.messages import JOINT_STATE, JointState, OperatingState, Pose, Text
from gpcorrect_service.protocol.cdr import (
    OPERATING_STATE,
    POSE_STAMPED,
    STRING_STAMPED,
    TF_MESSAGE,
    decode_cdr,
    ros_pose,
    ros_types,
)


def to_ros(message: msgspec.Struct) -> tuple[Any, str]:
    """Return the ROS message of a struct, and its type.

    Parameters
    ----------
    message : Struct
        JointState, Pose, OperatingState or Text.
    """
    kinds = ros_types().types
    match message:
        case JointState():
            arrays = (np.array(a or (), dtype=np.float64) for a in (message.position, message.velocity, message.effort))
            names = [f"joint_{j}" for j in range(1, len(message.position) + 1)]
            return kinds[JOINT_STATE](_header(message.stamp), names, *arrays), JOINT_STATE
        case Pose():
            return ros_pose(message.pose, *_time(message.stamp), message.frame), POSE_STAMPED
        case OperatingState():
            header = _header(message.stamp)
            return kinds[OPERATING_STATE](header, message.state, message.is_homed, message.is_busy), OPERATING_STATE
        case Text():
            return kinds[STRING_STAMPED](_header(message.stamp), message.string), STRING_STAMPED
    raise TypeError(f"{type(message).__name__} has no ROS message.")


def to_cdr(message: msgspec.Struct) -> bytes:
    """Return a struct as CDR with its 4-byte header.

    Parameters
    ----------
    message : Struct
        As for :func:`to_ros`.
    """
    ros, kind = to_ros(message)
    return bytes(ros_types().serialize_cdr(ros, kind))


def tf_cdr(message: Pose, base: str, child: str) -> bytes:
    """Return the pose of a frame as ROS nodes find it on `/tf`, in CDR.

    Parameters
    ----------
    message : Pose
    base, child : str
        Names of the frame that it is in, where the pose names none, and of the frame whose pose it is.
    """
    kinds = ros_types().types
    posed = ros_pose(message.pose, *_time(message.stamp), message.frame or base)
    p = posed.pose.position
    moved = kinds["geometry_msgs/msg/Transform"](
        kinds["geometry_msgs/msg/Vector3"](p.x, p.y, p.z), posed.pose.orientation
    )
    stamped = kinds["geometry_msgs/msg/TransformStamped"](posed.header, child, moved)
    return bytes(ros_types().serialize_cdr(kinds[TF_MESSAGE]([stamped]), TF_MESSAGE))


def from_cdr(data: bytes, ros_type: str) -> msgspec.Struct:
    """Read a struct from CDR.

    Parameters
    ----------
    data : bytes
    ros_type : str
        As `geometry_msgs/msg/PoseStamped`.

    Raises
    ------
    ServiceError
        BAD_INPUT: the bytes are no such message.
    """
    ros = decode_cdr(data, ros_type)
    stamp = ros.header.stamp.sec + 1e-9 * ros.header.stamp.nanosec
    match ros_type:
        case "sensor_msgs/msg/JointState":
            position, velocity, effort = (tuple(a.tolist()) or None for a in (ros.position, ros.velocity, ros.effort))
            return JointState(stamp, position or (), velocity, effort)
        case "geometry_msgs/msg/PoseStamped":
            p, q = ros.pose.position, ros.pose.orientation
            return Pose(stamp, (p.x, p.y, p.z, q.w, q.x, q.y, q.z), ros.header.frame_id)
        case "crtk_msgs/msg/OperatingState":
            return OperatingState(stamp, ros.state, ros.is_homed, ros.is_busy)
        case _:
            return Text(stamp, ros.string)


def _time(stamp: float) -> tuple[int, int]:
    return divmod(round(stamp * 1e9), 10**9)


def _header(stamp: float) -> Any:
    kinds = ros_types().types
    return kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](*_time(stamp)), "")
