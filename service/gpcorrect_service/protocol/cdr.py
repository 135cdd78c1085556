"""CDR for ROS users: `geometry_msgs/msg/PoseStamped` in and out, through rosbags' types."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import msgspec

from gpcorrect.errors import MissingExtraError
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.wire import SCHEMA_VERSION, Gaps

__all__ = ["CDR_ENCODING", "CdrBeside", "StampedPose", "read_pose", "write_pose"]

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
CDR_ENCODING = f"application/cdr;{POSE_STAMPED}"


@dataclass(frozen=True)
class StampedPose:
    """A pose `x y z qw qx qy qz`, with the header it came under."""

    pose: tuple[float, ...]
    sec: int
    nanosec: int
    frame_id: str


class CdrBeside(msgspec.Struct, frozen=True):
    """What a PoseStamped cannot carry: a correction's spread and status, and where it comes from; in JSON."""

    request_id: str
    model_id: str
    model_hash: str
    replica: str
    served_at: float
    serving_seconds: float
    std: Gaps
    interval95: Gaps
    in_domain: bool
    status: str
    reason: str
    schema_version: int = SCHEMA_VERSION


def read_pose(data: bytes) -> StampedPose:
    """Read one PoseStamped; ROS writes quaternions x y z w, here w comes first.

    Raises
    ------
    ServiceError
        BAD_INPUT: the bytes are no such message, its stamp is 0, or this server has no rosbags.
    """
    message = _decoded(data)
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise ServiceError(
            "BAD_INPUT", "the stamp of the message is 0.", hint="Set header.stamp: nothing else says when."
        )
    p, q = message.pose.position, message.pose.orientation
    return StampedPose((p.x, p.y, p.z, q.w, q.x, q.y, q.z), stamp.sec, stamp.nanosec, message.header.frame_id)


def write_pose(pose: StampedPose) -> bytes:
    """Write one PoseStamped."""
    store = _types()
    kinds = store.types
    x, y, z, qw, qx, qy, qz = pose.pose
    stamp = kinds["builtin_interfaces/msg/Time"](sec=pose.sec, nanosec=pose.nanosec)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=pose.frame_id)
    body = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=kinds["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    return bytes(store.serialize_cdr(kinds[POSE_STAMPED](header=header, pose=body), POSE_STAMPED))


def _decoded(data: bytes) -> Any:
    try:
        store = _types()
    except MissingExtraError as error:
        raise ServiceError("BAD_INPUT", "this server speaks no CDR.", hint=error.hint) from error
    from rosbags.serde import SerdeError

    try:
        return store.deserialize_cdr(data, POSE_STAMPED)
    except SerdeError as error:
        raise ServiceError(
            "BAD_INPUT",
            f"{len(data)} bytes are not a {POSE_STAMPED} in CDR ({error}).",
            hint="Send the message as ROS 2 serialises it, with its 4-byte header.",
        ) from error


@lru_cache(maxsize=1)
def _types() -> Any:
    if find_spec("rosbags") is None:
        raise MissingExtraError("rosbags", extra="ros", purpose="CDR")
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)
