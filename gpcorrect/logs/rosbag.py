"""ROS 1 bags and ROS 2 recordings (db3, MCAP), through rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpcorrect.errors import GpCorrectError, LogError, MissingExtraError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.messages import (
    RAVEN_STATE_DEFINITION,
    RAVEN_STATE_TYPE,
    Recorded,
    Times,
    array_row,
    in_one_order,
    joint_row,
    joint_streams,
    pose_row,
    pose_streams,
    raven_row,
    raven_streams,
)
from gpcorrect.logs.streams import Stream, combine
from gpcorrect.logs.tf import TF_TYPES, Tree, frames_of
from gpcorrect.logs.topics import choose_topics, element_of
from gpcorrect.types import CalibrationLog, LogMeta

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

LARGEST_PAGE = 65536  # bytes; SQLite writes it as 1
# How the messages about damaged recordings begin.
DAMAGED = "the recording cannot be read, it may be cut off or still being written"


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a recording of ROS topics onto one clock; header stamps count from the start of the recording."""
    options = settings.columns.bag
    with _opened(path) as bag:
        topics, remarks = choose_topics({c.topic: c.msgtype for c in bag.connections if c.msgcount}, options)
        recorded = _record(bag, topics)
        origin = bag.start_time
    recorded, moved = in_one_order(recorded)
    remarks, streams, meta = [*remarks, *moved], list[Stream](), LogMeta()
    for kind, messages in recorded.items():
        times = Times.of(messages, origin, options.clock)
        if kind == "raven_state":
            found, said, meta = raven_streams(messages, times, options.arm)
        else:
            found, said = (joint_streams if kind.endswith("_js") else pose_streams)(kind, messages, times)
        streams += found
        remarks += [*times.remarks, *said]
    log = combine(streams, options.base, options.max_gap, shifts=options.shifts, disorder=settings.disorder)
    return replace(log, meta=meta, remarks=(*remarks, *log.remarks))


@dataclass(frozen=True)
class Topic:
    """A topic of a recording: its type of message, how many there are, and how many a second."""

    name: str
    msgtype: str
    count: int
    rate: float


def topics_of(path: Path) -> tuple[list[Topic], dict[str, int]]:
    """Topics of a recording; and the pairs of frames whose transform moves, with their messages.

    Parameters
    ----------
    path : Path
    """
    with _opened(path) as bag:
        seconds = (bag.end_time - bag.start_time) / 1e9
        used = sorted((c for c in bag.connections if c.msgcount), key=lambda c: c.topic)
        rate = 1.0 / seconds if seconds > 0 else 0.0
        topics = [Topic(c.topic, c.msgtype, c.msgcount, (c.msgcount - 1) * rate) for c in used]
        tree, transforms = Tree(), [c for c in used if c.msgtype in TF_TYPES]
        for connection, receive, raw in bag.messages(connections=transforms) if transforms else ():
            message = bag.deserialize(raw, connection.msgtype)
            tree.add(message, receive, static=connection.topic.endswith("tf_static"))
    return topics, {r.topic: len(r.rows) for _, r in tree.edges.values() if r.topic in tree.moving()}


def _record(bag: AnyReader, topics: Mapping[str, str]) -> dict[str, Recorded]:
    """Messages of the chosen sources, by kind; transforms are read where a pair of frames, or nothing, was chosen."""
    types = {c.topic: c.msgtype for c in bag.connections}
    recorded: dict[str, list[Recorded]] = {}
    kinds: dict[str, Recorded] = {}
    for kind, source in topics.items():
        topic, place = element_of(source)
        if not frames_of(source):
            kinds[kind] = Recorded(source, _extract(kind, types[topic], place))
            recorded.setdefault(topic, []).append(kinds[kind])
    tree = Tree()
    wanted = not topics or any(frames_of(source) for source in topics.values())
    connections = [c for c in bag.connections if c.topic in recorded or (wanted and c.msgtype in TF_TYPES)]
    for connection, receive, raw in bag.messages(connections=connections):
        message = bag.deserialize(raw, connection.msgtype)
        if connection.topic in recorded:
            for one in recorded[connection.topic]:
                one.add(message, receive)
        else:
            tree.add(message, receive, static=connection.topic.endswith("tf_static"))
    if not topics:
        moving = tree.moving()
        if len(moving) != 1:
            hint = 'Choose one, or any pair of frames: [bag] tracker_topic = "/tf:base->tool".'
            raise LogError(f"expected one moving transform, found {', '.join(moving) or 'none'}.", hint=hint)
        topics = {"tracker_cp": moving[0]}
    for kind, source in topics.items():
        pair = frames_of(source)
        if pair:
            kinds[kind] = tree.pose(*pair)
    return {kind: kinds[kind] for kind in kinds if kinds[kind].rows}


def _extract(kind: str, msgtype: str, place: int | None) -> Callable[[Any], Any]:
    if kind == "raven_state":
        return raven_row
    if kind.endswith("_js"):
        return joint_row
    return array_row(place) if msgtype.endswith("/PoseArray") else pose_row


@contextmanager
def _opened(path: Path) -> Iterator[AnyReader]:
    """Open a recording; definitions come with it, or else from ROS 2 and this package."""
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
    except (GpCorrectError, MemoryError):
        raise
    except Exception as error:
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
