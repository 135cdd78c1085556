"""The same messages as ROS 2 writes them: CDR through rosbags' types, quaternions x y z w."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import msgspec
import numpy as np

from gpcorrect.errors import MissingExtraError
from gpcorrect_service.crtk.messages import JointState, OperatingState, Pose, Text
from gpcorrect_service.crtk.topics import JOINT_STATE, OPERATING_STATE, POSE_STAMPED, STRING_STAMPED
from gpcorrect_service.protocol.errors import ServiceError

__all__ = ["from_cdr", "ros_definition", "ros_store", "to_cdr", "to_ros"]

# https://github.com/collaborative-robotics/crtk_msgs, ROS 2
CRTK_DEFINITIONS = {
    OPERATING_STATE: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    STRING_STAMPED: "std_msgs/Header header\nstring string\n",
}


@lru_cache(maxsize=1)
def ros_store() -> Any:
    """Return rosbags' types with CRTK's own.

    Raises
    ------
    MissingExtraError
        rosbags is not installed.
    """
    if find_spec("rosbags") is None:
        raise MissingExtraError("rosbags", extra="ros", purpose="Speaking with ROS 2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in CRTK_DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def ros_definition(ros_type: str) -> tuple[str, str]:
    """Return a type's full text and its RIHS01 hash."""
    store = ros_store()
    return store.generate_msgdef(ros_type, ros_version=2)[0], store.hash_rihs01(ros_type)


def to_ros(message: msgspec.Struct, frame: str = "") -> tuple[Any, str]:
    """Return the ROS message of a struct, and its type."""
    kinds = ros_store().types
    match message:
        case JointState():
            arrays = (np.array(a or (), dtype=np.float64) for a in (message.position, message.velocity, message.effort))
            names = [f"joint_{j}" for j in range(1, len(message.position) + 1)]
            return kinds[JOINT_STATE](_header(message.stamp, frame), names, *arrays), JOINT_STATE
        case Pose():
            x, y, z, qw, qx, qy, qz = message.pose
            point = kinds["geometry_msgs/msg/Point"](x, y, z)
            turn = kinds["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
            header = _header(message.stamp, message.frame)
            return kinds[POSE_STAMPED](header, kinds["geometry_msgs/msg/Pose"](point, turn)), POSE_STAMPED
        case OperatingState():
            header = _header(message.stamp, frame)
            return kinds[OPERATING_STATE](header, message.state, message.is_homed, message.is_busy), OPERATING_STATE
        case Text():
            return kinds[STRING_STAMPED](_header(message.stamp, frame), message.string), STRING_STAMPED
    raise TypeError(f"{type(message).__name__} has no ROS message.")


def to_cdr(message: msgspec.Struct) -> bytes:
    """Return a struct as CDR with its 4-byte header."""
    ros, kind = to_ros(message)
    return bytes(ros_store().serialize_cdr(ros, kind))


def from_cdr(data: bytes, ros_type: str) -> msgspec.Struct:
    """Read a struct from CDR.

    Raises
    ------
    ServiceError
        BAD_INPUT: the bytes are no such message.
    """
    from rosbags.serde import SerdeError

    try:
        ros = ros_store().deserialize_cdr(data, ros_type)
    except (SerdeError, ValueError, IndexError) as error:
        raise ServiceError("BAD_INPUT", f"{len(data)} bytes are not a {ros_type} in CDR ({error}).") from error
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


def _header(stamp: float, frame: str) -> Any:
    kinds = ros_store().types
    nanoseconds = round(stamp * 1e9)
    time = kinds["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
    return kinds["std_msgs/msg/Header"](time, frame)
