"""CRTK's topics: their names under an arm, what they carry, and the ROS type that ROS users know them by."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from gpcorrect_service.crtk.messages import Event, Heartbeat, JointState, OperatingState, Pose, Report, Text

__all__ = ["TOPICS", "Topic", "topic"]

JOINT_STATE, POSE_STAMPED = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped"
OPERATING_STATE, STRING_STAMPED = "crtk_msgs/msg/OperatingState", "crtk_msgs/msg/StringStamped"


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
    """

    name: str
    form: type[msgspec.Struct]
    kind: str
    ros_type: str = ""


def _topics() -> tuple[Topic, ...]:
    joints = ("measured_js", "setpoint_js", "external_js", "servo_jp", "move_jp")
    poses = ("measured_cp", "setpoint_cp", "tracker_cp", "servo_cp", "move_cp")
    corrected = ("corrected/servo_cp", "corrected/move_cp")
    words = ("state_command", "error", "warning")
    return (
        *(Topic(name, JointState, "joint_state", JOINT_STATE) for name in joints),
        *(Topic(name, Pose, "pose", POSE_STAMPED) for name in (*poses, *corrected)),
        *(Topic(name, Text, "text", STRING_STAMPED) for name in words),
        Topic("operating_state", OperatingState, "operating_state", OPERATING_STATE),
        Topic("heartbeat", Heartbeat, "heartbeat"),
        Topic("event", Event, "event"),
        Topic("corrected/report", Report, "report"),
    )


TOPICS: dict[str, Topic] = {t.name: t for t in _topics()}


def topic(name: str) -> Topic:
    """Return the topic of that name."""
    return TOPICS[name]
