"""CDR for ROS users, through rosbags' types; and the question of `correct` as `geometry_msgs/msg/PoseStamped`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

from gpcorrect.errors import MissingExtraError
from gpcorrect_service.protocol.errors import bad_input

__all__ = ["CDR_ENCODING", "OPERATING_STATE", "POSE_STAMPED", "STRING_STAMPED", "StampedPose"]
__all__ += ["decode_cdr", "read_pose", "ros_pose", "ros_types", "write_pose"]

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"  # name of the ROS type
OPERATING_STATE = "crtk_msgs/msg/OperatingState"  # name of the ROS type
STRING_STAMPED = "crtk_msgs/msg/StringStamped"  # name of the ROS type
CDR_ENCODING = f"application/cdr;{POSE_STAMPED}"
# https://github.com/collaborative-robotics/crtk_msgs, ROS 2
CRTK_DEFINITIONS = {
    OPERATING_STATE: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    STRING_STAMPED: "std_msgs/Header header\nstring string\n",
}


@dataclass(frozen=True)
class StampedPose:
    """A pose `x y z qw qx qy qz`, with the header it came under."""

    pose: tuple[float, ...]
    sec: int
    nanosec: int
    frame_id: str


@lru_cache(maxsize=1)
def ros_types() -> Any:
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


def decode_cdr(data: bytes, ros_type: str) -> Any:
    """Read one ROS message.

    Parameters
    ----------
    data : bytes
        CDR with its 4-byte header.
    ros_type : str
        As `geometry_msgs/msg/PoseStamped`.

    Raises
    ------
    ServiceError
        BAD_INPUT: the bytes are no such message, or rosbags is not installed here.
    """
    try:
        store = ros_types()
    except MissingExtraError as error:
        raise bad_input("CDR is not spoken here.", error.hint) from error
    from rosbags.serde import SerdeError

    try:
        return store.deserialize_cdr(data, ros_type)
    except (SerdeError, ValueError, IndexError) as error:
        raise bad_input(
            f"{len(data)} bytes are not a {ros_type} in CDR ({error}).",
            "Send the message as ROS 2 serialises it, with its 4-byte header.",
        ) from error


def ros_pose(pose: tuple[float, ...], sec: int, nanosec: int, frame_id: str) -> Any:
    """Return a PoseStamped; ROS writes quaternions x y z w.

    Parameters
    ----------
    pose : 7 float
        x y z in m, then the quaternion w x y z.
    sec, nanosec : int
        Stamp.
    frame_id : str
    """
    kinds = ros_types().types
    x, y, z, qw, qx, qy, qz = pose
    stamp = kinds["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    body = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=kinds["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    return kinds[POSE_STAMPED](header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id), pose=body)


def read_pose(data: bytes) -> StampedPose:
    """Read the question of `correct`.

    Parameters
    ----------
    data : bytes
        A PoseStamped in CDR.

    Raises
    ------
    ServiceError
        BAD_INPUT: as :func:`decode_cdr`, or its stamp is 0.
    """
    message = decode_cdr(data, POSE_STAMPED)
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise bad_input("the stamp of the message is 0.", "Set header.stamp: nothing else says when.")
    p, q = message.pose.position, message.pose.orientation
    return StampedPose((p.x, p.y, p.z, q.w, q.x, q.y, q.z), stamp.sec, stamp.nanosec, message.header.frame_id)


def write_pose(stamped: StampedPose) -> bytes:
    """Write the answer of `correct`.

    Parameters
    ----------
    stamped : StampedPose
    """
    message = ros_pose(stamped.pose, stamped.sec, stamped.nanosec, stamped.frame_id)
    return bytes(ros_types().serialize_cdr(message, POSE_STAMPED))
