"""CRTK's topics and their messages as they travel on native keys: strict structs in MessagePack or JSON; and for ROS 2.

SI; poses are `x y z qw qx qy qz`; stamps are the robot's clock in s, and never 0 (https://crtk-robotics.readthedocs.io).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from gpcorrect_service.protocol import ros
from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.protocol.messages import JointState, Numbers, Row, State

__all__ = ["TOPICS", "Event", "Heartbeat", "JointState", "Message", "OperatingState", "Pose", "Report"]
__all__ += ["State", "Text", "Topic", "View", "checked_numbers"]


class Pose(msgspec.Struct, frozen=True):
    """A pose: what `measured_cp`, `setpoint_cp`, `tracker_cp`, `servo_cp` and `move_cp` carry; a twist where known."""

    stamp: float
    pose: Numbers
    frame: str = ""
    twist: Numbers | None = None


class OperatingState(msgspec.Struct, frozen=True):
    """CRTK's operating state."""

    stamp: float
    state: State
    is_homed: bool
    is_busy: bool


class Text(msgspec.Struct, frozen=True):
    """A word or a sentence: `state_command`, `error`, `warning`."""

    stamp: float
    string: str


class Event(msgspec.Struct, frozen=True):
    """What a tool says of its motion, so that a recorder knows: trajectory numbers from 0, -1 between them."""

    stamp: float
    trajectory: int


class Heartbeat(msgspec.Struct, frozen=True):
    """That the arm is alive: how fast it runs, Hz on its own clock, and how many ticks came late so far."""

    stamp: float
    rate: float
    late: int


class Report(msgspec.Struct, frozen=True):
    """What the pre-filter made of a desired pose: both poses, and how sure the correction is.

    `reference` is what registration alone would command: the correction is the command less that.
    """

    stamp: float
    desired: Numbers
    command: Numbers
    std: Row
    interval95: Row
    in_domain: bool
    status: str
    reason: str
    seconds: float
    model_id: str
    model_hash: str
    reference: Numbers | None = None


class View(msgspec.Struct, frozen=True):
    """What cameras show at this moment, for people: one small JPEG of all of them."""

    stamp: float
    jpeg: bytes


Message = JointState | Pose | OperatingState | Text | Event | Heartbeat | Report | View


def checked_numbers(numbers: Sequence[float | None], count: int, what: str) -> Numbers:
    """Return numbers that are finite and as many as expected; BAD_INPUT where they are not.

    Parameters
    ----------
    numbers : sequence of float or None
    count : int
    what : str, name for messages
    """
    finite = tuple(one for one in numbers if one is not None and math.isfinite(one))
    if not len(numbers) == len(finite) == count:
        raise bad_input(f"{what} must be {count} finite numbers, got {list(numbers)}.")
    return finite


@dataclass(frozen=True)
class Topic:
    """One topic."""

    name: str  # behind the arm's name
    form: type[msgspec.Struct]  # struct on native keys
    kind: str  # name of the struct in zenoh encodings
    ros_type: str = ""  # empty where ROS users have no such topic
    # whether a ROS node that comes late hears the last message, as CRTK has it of states ("transient local")
    latched: bool = False
    # whether messages overtake those of other topics and have a queue of their own: of streams that a loaded machine
    # sends, what finds the queue full is dropped, and with them went one first complaint in twenty
    urgent: bool = False
    # behind the arm's name, the frame whose pose it is: ROS nodes find it on `/tf` too. Empty for none
    child: str = ""


TF = Topic("tf", Pose, "pose", ros.TF_MESSAGE)
"""Where ROS nodes look for frames; of no arm."""
TOPICS: dict[str, Topic] = {
    topic.name: topic
    for topic in (
        *(
            Topic(name, JointState, "joint_state", ros.JOINT_STATE)
            for name in ("measured_js", "setpoint_js", "external_js", "servo_jp", "move_jp")
        ),
        *(Topic(name, Pose, "pose", ros.POSE_STAMPED) for name in ("setpoint_cp", "tracker_cp", "servo_cp", "move_cp")),
        Topic("measured_cp", Pose, "pose", ros.POSE_STAMPED, child="tool"),
        *(
            Topic(f"corrected/{name}", Pose, "pose", ros.POSE_STAMPED, child="corrected_tool")
            for name in ("servo_cp", "move_cp")
        ),
        *(Topic(name, Text, "text", ros.STRING_STAMPED, urgent=True) for name in ("state_command", "error", "warning")),
        Topic("operating_state", OperatingState, "operating_state", ros.OPERATING_STATE, latched=True),
        Topic("heartbeat", Heartbeat, "heartbeat"),
        Topic("event", Event, "event", urgent=True),
        Topic("corrected/report", Report, "report"),
        Topic("view", View, "view"),
    )
}


def to_cdr(message: msgspec.Struct) -> bytes:
    """Return a struct as CDR with its 4-byte header.

    Parameters
    ----------
    message : JointState, Pose, OperatingState or Text
    """
    kinds = ros.ros_types().types
    match message:
        case JointState():
            arrays = (np.array(a or (), dtype=np.float64) for a in (message.position, message.velocity, message.effort))
            names = [f"joint_{j}" for j in range(1, len(message.position) + 1)]
            found = kinds[ros.JOINT_STATE](_header(message.stamp), names, *arrays)
        case Pose():
            found = ros.ros_pose(ros.StampedPose(message.pose, *_time(message.stamp), message.frame))
        case OperatingState():
            header = _header(message.stamp)
            found = kinds[ros.OPERATING_STATE](header, message.state, message.is_homed, message.is_busy)
        case Text():
            found = kinds[ros.STRING_STAMPED](_header(message.stamp), message.string)
        case _:
            raise TypeError(f"{type(message).__name__} has no ROS message.")
    return bytes(ros.ros_types().serialize_cdr(found, found.__msgtype__))


def tf_cdr(message: Pose, base: str, child: str) -> bytes:
    """Return the pose of a frame as ROS nodes find it on `/tf`, in CDR.

    Parameters
    ----------
    message : Pose
    base, child : str, names of the frame that it is in, where the pose names none, and of the frame whose pose it is
    """
    kinds = ros.ros_types().types
    posed = ros.ros_pose(ros.StampedPose(message.pose, *_time(message.stamp), message.frame or base))
    p = posed.pose.position
    moved = kinds["geometry_msgs/msg/Transform"](
        kinds["geometry_msgs/msg/Vector3"](p.x, p.y, p.z), posed.pose.orientation
    )
    stamped = kinds["geometry_msgs/msg/TransformStamped"](posed.header, child, moved)
    return bytes(ros.ros_types().serialize_cdr(kinds[ros.TF_MESSAGE]([stamped]), ros.TF_MESSAGE))


def from_cdr(data: bytes, ros_type: str) -> msgspec.Struct:
    """Read a struct from CDR; BAD_INPUT where the bytes are no such message.

    Parameters
    ----------
    data : bytes
    ros_type : str, as `geometry_msgs/msg/PoseStamped`
    """
    found = ros.decode_cdr(data, ros_type)
    stamp = found.header.stamp.sec + 1e-9 * found.header.stamp.nanosec
    match ros_type:
        case ros.JOINT_STATE:
            position, velocity, effort = (
                tuple(a.tolist()) or None for a in (found.position, found.velocity, found.effort)
            )
            return JointState(stamp, position or (), velocity, effort)
        case ros.POSE_STAMPED:
            p, q = found.pose.position, found.pose.orientation
            return Pose(stamp, (p.x, p.y, p.z, q.w, q.x, q.y, q.z), found.header.frame_id)
        case ros.OPERATING_STATE:
            return OperatingState(stamp, found.state, found.is_homed, found.is_busy)
        case _:
            return Text(stamp, found.string)


def _time(stamp: float) -> tuple[int, int]:
    return divmod(round(stamp * 1e9), 10**9)


def _header(stamp: float) -> Any:
    kinds = ros.ros_types().types
    return kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](*_time(stamp)), "")
