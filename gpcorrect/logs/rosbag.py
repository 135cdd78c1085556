"""ROS 1 bags and ROS 2 recordings (db3, MCAP), through rosbags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gpcorrect.errors import GpCorrectError, LogError, MissingExtraError
from gpcorrect.logs.columns import BagOptions, ReadSettings
from gpcorrect.logs.messages import Recorded, Times, joint_row, joint_streams, pose_row, pose_streams
from gpcorrect.logs.raven2 import RAVEN_STATE_DEFINITION, RAVEN_STATE_TYPE, raven_row, raven_streams
from gpcorrect.logs.streams import combine
from gpcorrect.types import CalibrationLog, LogMeta

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

__all__ = ["read"]

LARGEST_PAGE = 65536  # bytes; SQLite writes it as 1
DAMAGED = "the recording cannot be read, it may be cut off or still being written"

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


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a recording of ROS topics onto one clock; header stamps count from the start of the recording.

    Parameters
    ----------
    path, settings
        See :func:`gpcorrect.logs.read_log`.

    Raises
    ------
    LogError
        The recording is damaged, or it does not say which topics to take.
    MissingExtraError
        The library rosbags is not installed.
    """
    options = settings.columns.bag
    with _opened(path) as bag:
        choice = _choose_topics({c.topic: c.msgtype for c in bag.connections if c.msgcount}, options)
        recorded = _record(bag, choice)
        origin = bag.start_time
    remarks, parts = list(choice.remarks), []
    for kind, messages in recorded.items():
        times = Times.of(messages, origin, options.clock)
        if kind == "raven_state":
            parts.append(raven_streams(messages, times, options.arm))
        else:
            parts.append((joint_streams if kind.endswith("_js") else pose_streams)(kind, messages, times))
        remarks += [*times.remarks, *parts[-1].remarks]
    streams = [stream for part in parts for stream in part.streams]
    log = combine(streams, options.base, options.max_gap, shifts=options.shifts, disorder=settings.disorder)
    meta = next((part.meta for part in parts if part.meta != LogMeta()), LogMeta())
    return replace(log, meta=meta, remarks=(*remarks, *log.remarks))


def _record(bag: AnyReader, choice: Choice) -> dict[str, Recorded]:
    """Messages of the chosen topics, by kind."""
    recorded = {}
    for kind, topic in choice.topics.items():
        extract = raven_row if kind == "raven_state" else joint_row if kind.endswith("_js") else pose_row
        recorded[topic] = Recorded(topic, extract)
    connections = [c for c in bag.connections if c.topic in recorded]
    for connection, receive, raw in bag.messages(connections=connections):
        recorded[connection.topic].add(bag.deserialize(raw, connection.msgtype), receive)
    return {kind: recorded[topic] for kind, topic in choice.topics.items() if recorded[topic].rows}


@contextmanager
def _opened(path: Path) -> Iterator[AnyReader]:
    """Open a recording; definitions come with it, or else from ROS 2 and this package.

    Raises
    ------
    LogError
        The recording is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", extra="ros", purpose="Reading ROS recordings") from error
    for database in [path] if path.suffix == ".db3" else path.glob("*.db3"):
        _check_length(database)
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(RAVEN_STATE_DEFINITION, RAVEN_STATE_TYPE))
    try:
        with AnyReader([path], default_typestore=store) as bag:
            yield bag
    except GpCorrectError:
        raise
    except _damage() as error:
        hint = "A ROS 1 bag without its index can be repaired with: rosbag reindex."
        raise LogError(f"{DAMAGED}: {error}.", hint=hint if path.suffix == ".bag" else "") from error


def _check_length(database: Path) -> None:
    """Refuse a database shorter than its header says: one that lost its last pages may still open."""
    with database.open("rb") as file:
        head = file.read(32)
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    expected = (LARGEST_PAGE if page == 1 else page) * pages
    if database.stat().st_size < expected:
        raise LogError(f"{DAMAGED}: expected {expected} bytes, found {database.stat().st_size}.")


def _damage() -> tuple[type[Exception], ...]:
    """List what rosbags and the database library below it raise on damaged bytes (found by damaging some)."""
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Ros1Error
    from rosbags.rosbag2 import ReaderError as Ros2Error
    from rosbags.typesys import TypesysError

    errors: list[type[Exception]] = [AnyReaderError, Ros1Error, Ros2Error, TypesysError]
    errors += [ValueError, TypeError, AssertionError, OverflowError, MemoryError, LookupError, EOFError]
    with suppress(ImportError):
        import apsw

        errors.append(apsw.Error)
    return tuple(errors)


@dataclass(frozen=True)
class Choice:
    """What to read: a topic for each kind of message, and what had to be decided."""

    topics: Mapping[str, str]
    remarks: tuple[str, ...] = ()


def _choose_topics(types: Mapping[str, str], options: BagOptions) -> Choice:
    """Choose one robot and at most one tracker among topics and their message types."""
    tracker, remarks = _tracker(types, options)
    robots: dict[str, dict[str, str]] = {}  # topics by CRTK name, by namespace
    for topic, kind in types.items():
        space, _, name = topic.rpartition("/")
        if topic != tracker and kind in ROBOT_TOPICS.get(name, ()):
            robots.setdefault(_slashed(space), {})[name] = topic
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
