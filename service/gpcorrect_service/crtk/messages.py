"""CRTK's topics and their messages as they travel on native keys: strict structs in MessagePack or JSON.

SI; poses are `x y z qw qx qy qz`; stamps are the robot's clock in s, and never 0 (https://crtk-robotics.readthedocs.io).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from gpcorrect_service.protocol.cdr import OPERATING_STATE, POSE_STAMPED, STRING_STAMPED, TF_MESSAGE
from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.protocol.messages import JointState, Numbers, Row, State

__all__ = ["TOPICS", "Event", "Heartbeat", "JointState", "Message", "OperatingState", "Pose", "Report"]
__all__ += ["State", "Text", "Topic", "checked_numbers"]

JOINT_STATE = "sensor_msgs/msg/JointState"  # name of the ROS type


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


Message = JointState | Pose | OperatingState | Text | Event | Heartbeat | Report


def checked_numbers(numbers: Sequence[float | None], count: int, what: str) -> Numbers:
    """Return numbers that are finite and as many as expected.

    Parameters
    ----------
    numbers : sequence of float or None
    count : int
    what : str
        Name for messages.

    Raises
    ------
    ServiceError
        BAD_INPUT: they are not.
    """
    finite = tuple(one for one in numbers if one is not None and math.isfinite(one))
    if not len(numbers) == len(finite) == count:
        raise bad_input(f"{what} must be {count} finite numbers, got {list(numbers)}.")
    return finite


@dataclass(frozen=True)
class Topic:
    """One topic.

    Parameters
    ----------
    name : str
        Behind the arm's name.
    form : type
        Struct on native keys.
    kind : str
        Name of the struct in zenoh encodings.
    ros_type : str
        Empty where ROS users have no such topic.
    latched : bool
        Whether a ROS node that comes late hears the last message, as CRTK has it of states ("transient local").
    urgent : bool
        Whether messages overtake those of other topics and have a queue of their own: of streams that a loaded machine
        sends, what finds the queue full is dropped, and with them went one first complaint in twenty.
    child : str
        Behind the arm's name, the frame whose pose it is: ROS nodes find it on `/tf` too. Empty for none.
    """

    name: str
    form: type[msgspec.Struct]
    kind: str
    ros_type: str = ""
    latched: bool = False
    urgent: bool = False
    child: str = ""


TF = Topic("tf", Pose, "pose", TF_MESSAGE)
"""Where ROS nodes look for frames; of no arm."""
TOPICS: dict[str, Topic] = {
    topic.name: topic
    for topic in (
        *(
            Topic(name, JointState, "joint_state", JOINT_STATE)
            for name in ("measured_js", "setpoint_js", "external_js", "servo_jp", "move_jp")
        ),
        *(Topic(name, Pose, "pose", POSE_STAMPED) for name in ("setpoint_cp", "tracker_cp", "servo_cp", "move_cp")),
        Topic("measured_cp", Pose, "pose", POSE_STAMPED, child="tool"),
        *(
            Topic(f"corrected/{name}", Pose, "pose", POSE_STAMPED, child="corrected_tool")
            for name in ("servo_cp", "move_cp")
        ),
        *(Topic(name, Text, "text", STRING_STAMPED, urgent=True) for name in ("state_command", "error", "warning")),
        Topic("operating_state", OperatingState, "operating_state", OPERATING_STATE, latched=True),
        Topic("heartbeat", Heartbeat, "heartbeat"),
        Topic("event", Event, "event", urgent=True),
        Topic("corrected/report", Report, "report"),
    )
}
