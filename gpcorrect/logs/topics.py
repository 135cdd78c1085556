"""Which topics of a ROS recording are what: one robot, at most one tracker, by names and types of message."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import BagOptions

PLAIN = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
OTHER = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseArray",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/Pose",
)
POSE_TYPES = frozenset(PLAIN + OTHER)
TF_TYPES = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})
JOINT_TYPES = frozenset({"sensor_msgs/msg/JointState"})
ROBOT_TOPICS = dict.fromkeys(("setpoint_cp", "measured_cp"), POSE_TYPES)
ROBOT_TOPICS |= dict.fromkeys(("setpoint_js", "measured_js", "external_js"), JOINT_TYPES)
COMMANDED = {"setpoint_cp", "setpoint_js", "measured_js"}  # by which a robot is known from a tracker
TRACKER_WORDS = re.compile(
    "track|marker|mocap|motion_capture|vrpn|optitrack|vicon|qualisys|phasespace|polaris|ndi|atracsys|fusion|aruco|"
    "apriltag|camera|fiducial"
)


def _slashed(name: str) -> str:
    """Return a topic or namespace with one slash before it, which some recorders leave out."""
    return "/" + name.strip("/")


def element_of(source: str) -> tuple[str, int | None]:
    """Topic and place of a pose of an array, such as `/poses[1]`; no place for other sources.

    Parameters
    ----------
    source : str, as :func:`choose_topics` returns it
    """
    match = re.fullmatch(r"(.*)\[(\d+)\]", source)
    return (match[1], int(match[2])) if match else (source, None)


def frames_of(name: str) -> tuple[str, str] | None:
    """Parent and child of a name such as `/tf:base->tool`; None for the name of a topic.

    Parameters
    ----------
    name : str, as the user wrote it
    """
    match = re.fullmatch(r"/?tf:/?(.+?)\s*->\s*/?(.+)", name.strip())
    return (match[1], match[2]) if match else None


def choose_topics(types: Mapping[str, str], options: BagOptions) -> tuple[dict[str, str], list[str]]:
    """Choose one robot and at most one tracker; remark on what had to be decided.

    The keys are signals of poses, CRTK names of joint states, or "raven_state"; the sources topics, poses of an array
    (`/poses[1]`) or pairs of frames (`/tf:base->tool`).

    Parameters
    ----------
    types : mapping of str to str, types of message by topic
    options : BagOptions
    """
    tracker, remarks = _tracker(types, options)
    topics: dict[str, str] = {
        kind: _stated(types, kind, name) for kind, name in options.topics.items() if kind != "tracker_cp"
    }
    raven = [topic for topic, kind in types.items() if kind.endswith("/raven_state")]
    if not topics:
        robots = _robots(types, tracker)
        if raven and (options.arm is not None or (options.namespace is None and not robots)):
            topics = {"raven_state": _only(raven, "RAVEN-II state topic")}
        else:
            topics, remark = _robot(robots, options.namespace)
            remarks += remark
        joints = [topic for topic, kind in types.items() if kind in JOINT_TYPES]
        if joints and not topics:
            hint = "say whose they are in a mapping file, under [bag.topics]"
            remarks.append(
                f"joint states that no CRTK name goes with are not read: {', '.join(sorted(joints))}; {hint}."
            )
    if tracker:
        topics = {**topics, "tracker_cp": tracker}
    if not topics and not TF_TYPES & set(types.values()):
        listed = ", ".join(f"{t} ({k})" for t, k in sorted(types.items())) or "none"
        hint = f"Say which they are in a mapping file, under [bag.topics]. Topics: {listed}."
        raise LogError("the recording holds no CRTK, RAVEN-II or tracker topic.", hint=hint)
    return topics, remarks


def _stated(types: Mapping[str, str], kind: str, name: str) -> str:
    """Return the source that the user names for a kind of signal, as the recording writes it."""
    wanted = JOINT_TYPES if kind.endswith("_js") else POSE_TYPES
    if frames_of(name) and wanted is POSE_TYPES:
        return name
    topic, place = element_of(name)
    fitting = [t for t in types if types[t] in wanted]
    found = next((t for t in fitting if _slashed(t) == _slashed(topic)), None)
    if found is None:
        what = "joint state" if wanted is JOINT_TYPES else "pose"
        hint = f"{what.capitalize()} topics here: {', '.join(fitting)}."
        raise LogError(f"there is no {what} topic {name}.", hint=hint)
    return found if place is None else f"{found}[{place}]"


def _robots(types: Mapping[str, str], tracker: str) -> dict[str, dict[str, str]]:
    """Topics by CRTK name, by namespace."""
    robots: dict[str, dict[str, str]] = {}
    for topic, kind in types.items():
        space, _, name = _slashed(topic).rpartition("/")
        if topic != element_of(tracker)[0] and kind in ROBOT_TOPICS.get(name, ()):
            robots.setdefault(_slashed(space), {})[name] = topic
    return robots


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
        remark = f"read {root}; its parts {', '.join(sorted(parts))} were left out."
        return robots[root], [remark] if parts else []
    raise LogError(
        f"the recording holds several robots: {listed}.", hint="Choose one with --arm (in Python namespace)."
    )


def _tracker(types: Mapping[str, str], options: BagOptions) -> tuple[str, list[str]]:
    """Topic of the tracker, "" for none; messages that hold nothing but a stamped pose come before others."""
    stated = options.topics.get("tracker_cp", options.tracker_topic)
    if stated is not None:
        return (_stated(types, "tracker_cp", stated) if stated else ""), []
    taken = {_slashed(element_of(topic)[0]) for topic in options.topics.values()}
    # What is seen in the namespace of a robot that is not wanted is not seen of the one that is.
    others, wanted = set[str](), options.namespace
    if wanted is not None:
        robots = {space for space, topics in _robots(types, "").items() if topics.keys() & COMMANDED}
        others = {space for space in robots if not (_within(space, {_slashed(wanted)}) or _within(wanted, {space}))}
    free = [
        topic
        for topic, kind in types.items()
        if kind in POSE_TYPES
        and _slashed(topic) not in taken
        and _may_track(topic, types)
        and not _within(topic, others)
    ]
    for named in (True, False):
        for kinds in (PLAIN, OTHER):
            found = [t for t in free if types[t] in kinds and (TRACKER_WORDS.search(t.lower()) or not named)]
            if found:
                topic = _only(found, "topic that may be the tracker")
                return topic, [f"{topic} was taken for the tracker."]
    return "", []


def _within(name: str, spaces: set[str]) -> bool:
    return any(f"{_slashed(name)}/".startswith(f"{space.rstrip('/')}/") for space in spaces)


def _may_track(topic: str, types: Mapping[str, str]) -> bool:
    """Whether a pose may be a tracker's: of CRTK poses one whose namespace only measures, and sounds like a tracker."""
    space, _, name = _slashed(topic).rpartition("/")
    if not name.endswith("_cp") or name == "tracker_cp":
        return True
    others = {f"{space}/{other}" for other in ROBOT_TOPICS if other != "measured_cp"}
    sounds = TRACKER_WORDS.search(space.lower()) is not None
    return name == "measured_cp" and sounds and not others & {_slashed(t) for t in types}


def _only(topics: Sequence[str], what: str) -> str:
    if len(topics) > 1:
        hint = "Choose one with --tracker-topic (in Python tracker_topic), or none with an empty name."
        raise LogError(f"the recording holds more than one {what}: {', '.join(sorted(topics))}.", hint=hint)
    return topics[0]
