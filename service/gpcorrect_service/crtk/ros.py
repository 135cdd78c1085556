"""The same messages for ROS 2: CDR, and the keys, attachments and liveliness tokens of rmw_zenoh.

After the design document and the released sources of rmw_zenoh_cpp (0.2.4 in Jazzy and newer; Humble, Kilted, Rolling).
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from gpcorrect_service.crtk.messages import JOINT_STATE, JointState, OperatingState, Pose, Text
from gpcorrect_service.protocol.cdr import (
    OPERATING_STATE,
    POSE_STAMPED,
    STRING_STAMPED,
    decode_cdr,
    ros_pose,
    ros_types,
)

__all__ = [
    "DEFAULT_QOS",
    "LATCHED_QOS",
    "RmwNode",
    "RosDistro",
    "attachment",
    "from_cdr",
    "gid_of",
    "rmw_key",
    "to_cdr",
    "to_ros",
]

RosDistro = Literal["humble", "jazzy", "rolling"]
"""Who listens: Humble has no type hashes, and its keys end otherwise than those of Jazzy, Kilted and Rolling."""

GID_BYTES = 16  # length of a sender's name
ATTACHMENT = struct.Struct("<qqB16s")
DEFAULT_QOS = "::,10:,:,:,,"  # reliable, volatile, keep last 10
LATCHED_QOS = ":1:,1:,:,:,,"  # reliable, transient local, keep last 1: who comes late hears the last one
NO_HASH = "TypeHashNotSupported"  # rmw_zenoh, branch humble (pull request 388): stands where a hash would


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


def rmw_key(domain: int, topic: str, ros_type: str, distro: RosDistro) -> str:
    """Return the zenoh key of a ROS topic: `domain/topic/type/hash`.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.
    topic, ros_type : str
        As `arm1/servo_cp` and `geometry_msgs/msg/PoseStamped`.
    distro : str
        ROS distribution of the nodes that use it.
    """
    return f"{domain}/{topic.strip('/')}/{_type_and_hash(ros_type, distro)}"


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return what rmw_zenoh expects beside every message.

    Parameters
    ----------
    sequence : int
        Its number, from 1.
    stamp_ns : int
        Its time, ns since 1970.
    gid : 16 bytes
        Its sender.
    """
    return ATTACHMENT.pack(sequence, stamp_ns, GID_BYTES, gid)


@dataclass(frozen=True)
class RmwNode:
    """A node as the ROS graph shows it.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.
    zid : str
        Of the zenoh session.
    name : str
        Of the node.
    distro : str
        ROS distribution of the nodes that see it.
    """

    domain: int
    zid: str
    name: str
    distro: RosDistro

    def node_token(self) -> str:
        """Return the liveliness key that shows the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/%/%/{self.name}"

    def topic_token(self, number: int, kind: str, topic: str, ros_type: str, qos: str = DEFAULT_QOS) -> str:
        """Return the liveliness key of a publisher or a subscription.

        Parameters
        ----------
        number : int
            Which one of the node.
        kind : str
            "MP" for a publisher, "MS" for a subscription.
        topic, ros_type : str
            As for :func:`rmw_key`.
        qos : str
            Quality of service in rmw_zenoh's short form.
        """
        mangled = "%" + topic.strip("/").replace("/", "%")
        described = f"{mangled}/{_type_and_hash(ros_type, self.distro)}/{qos}"
        return f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{kind}/%/%/{self.name}/{described}"


def gid_of(token: str) -> bytes:
    """Return a sender's 16 bytes: only that they differ from others' matters.

    Parameters
    ----------
    token : str
        Its liveliness key.
    """
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def _type_and_hash(ros_type: str, distro: RosDistro) -> str:
    package, _, name = ros_type.split("/")
    hashed = NO_HASH if distro == "humble" else ros_types().hash_rihs01(ros_type)
    return f"{package}::msg::dds_::{name}_/{hashed}"
