"""Which topics of a recording are which signals: CRTK names under a namespace, a tracker, RAVEN-II state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import BagOptions

__all__ = ["Choice", "choose_topics"]

POSE_TYPES = frozenset({"geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"})
JOINT_TYPES = frozenset({"sensor_msgs/msg/JointState"})
ROBOT_TOPICS = {
    "setpoint_cp": POSE_TYPES,
    "measured_cp": POSE_TYPES,
    "setpoint_js": JOINT_TYPES,
    "measured_js": JOINT_TYPES,
    "external_js": JOINT_TYPES,
}
TRACKER_WORDS = (
    "track",
    "marker",
    "mocap",
    "motion_capture",
    "vrpn",
    "optitrack",
    "vicon",
    "qualisys",
    "phasespace",
    "polaris",
    "ndi",
    "atracsys",
    "fusion",
    "aruco",
    "apriltag",
    "camera",
    "fiducial",
)


@dataclass(frozen=True)
class Choice:
    """What to read: a topic for each kind of message, and what had to be decided."""

    topics: Mapping[str, str]
    remarks: tuple[str, ...] = ()


def choose_topics(types: Mapping[str, str], options: BagOptions) -> Choice:
    """Choose one robot and at most one tracker.

    Parameters
    ----------
    types : mapping of topic to message type
        Topics of the recording that hold messages.
    options : BagOptions
        What the user said.

    Returns
    -------
    Choice
        Topics by kind: setpoint_cp, measured_cp, setpoint_js, measured_js, external_js, tracker_cp, raven_state.

    Raises
    ------
    LogError
        There is nothing to read, more than one candidate, or no topic of a name that the user gave.
    """
    tracker, remarks = _tracker(types, options)
    robots = _namespaces(types, without=tracker)
    raven = [topic for topic, kind in types.items() if kind.endswith("/raven_state")]
    if raven and (options.arm is not None or (options.namespace is None and not robots)):
        topics = {"raven_state": _only(raven, "RAVEN-II state topic")}
    else:
        topics, remark = _robot(robots, options.namespace)
        remarks += remark
    if tracker:
        topics = {**topics, "tracker_cp": tracker}
    if not topics:
        listed = ", ".join(f"{t} ({k})" for t, k in sorted(types.items())) or "none"
        raise LogError("the recording holds no CRTK, RAVEN-II or tracker topic.", hint=f"Topics: {listed}.")
    return Choice(topics, tuple(remarks))


def _slashed(name: str) -> str:
    return "/" + name.strip("/")


def _namespaces(types: Mapping[str, str], without: str) -> dict[str, dict[str, str]]:
    """Topics by CRTK name, by namespace."""
    found: dict[str, dict[str, str]] = {}
    for topic, kind in types.items():
        space, _, name = topic.rpartition("/")
        if topic != without and kind in ROBOT_TOPICS.get(name, ()):
            found.setdefault(_slashed(space), {})[name] = topic
    return found


def _robot(robots: dict[str, dict[str, str]], wanted: str | None) -> tuple[dict[str, str], list[str]]:
    """Topics of one robot: the one wanted, the only one, or the one that all other namespaces are part of."""
    listed = ", ".join(sorted(robots)) or "none"
    if wanted is not None:
        if _slashed(wanted) not in robots:
            raise LogError(f"there is no robot {wanted}.", hint=f"Namespaces here: {listed}.")
        return robots[_slashed(wanted)], []
    if not robots:
        return {}, []
    root = min(robots, key=len)
    parts = [space for space in robots if space != root]
    if all(space.startswith(root.rstrip("/") + "/") for space in parts):
        said = f"read {root}; its parts {', '.join(sorted(parts))} were left out."
        return robots[root], [said] if parts else []
    raise LogError(f"the recording holds several robots: {listed}.", hint="Choose one with namespace.")


def _tracker(types: Mapping[str, str], options: BagOptions) -> tuple[str, list[str]]:
    """Topic of the tracker, "" for none."""
    poses = [topic for topic, kind in types.items() if kind in POSE_TYPES]
    if options.tracker_topic is not None:
        wanted = options.tracker_topic and _slashed(options.tracker_topic)
        if wanted and wanted not in poses:
            raise LogError(f"there is no pose topic {wanted}.", hint=f"Pose topics here: {', '.join(poses)}.")
        return wanted, []
    free = [
        topic
        for topic in poses
        if not topic.endswith("_cp") or topic.endswith("/tracker_cp") or _is_tracking(topic, types)
    ]
    named = [topic for topic in free if _has_tracker_word(topic)]
    found = named or free
    if not found:
        return "", []
    topic = _only(found, "topic that may be the tracker")
    return topic, [f"{topic} was taken for the tracker."]


def _has_tracker_word(topic: str) -> bool:
    return any(word in topic.lower() for word in TRACKER_WORDS)


def _is_tracking(topic: str, types: Mapping[str, str]) -> bool:
    """Whether a CRTK pose is a tracker's: its namespace only measures, and sounds like one."""
    space, _, name = topic.rpartition("/")
    others = [f"{space}/{other}" for other in ROBOT_TOPICS if other != "measured_cp"]
    return name == "measured_cp" and _has_tracker_word(space) and not any(t in types for t in others)


def _only(topics: Sequence[str], what: str) -> str:
    if len(topics) > 1:
        hint = "Choose one with tracker_topic, or none with an empty name."
        raise LogError(f"the recording holds more than one {what}: {', '.join(sorted(topics))}.", hint=hint)
    return topics[0]
