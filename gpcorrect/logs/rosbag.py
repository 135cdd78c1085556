"""ROS 1 bags and ROS 2 recordings (db3, MCAP), through rosbags; and the tree of frames on /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import GpCorrectError, LogError, MissingExtraError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.messages import (
    RAVEN_STATE_DEFINITION,
    RAVEN_STATE_TYPE,
    Recorded,
    extractor,
    in_one_order,
    pose_row,
    streams_of,
)
from gpcorrect.logs.streams import Stream, combine, interpolate
from gpcorrect.logs.topics import TF_TYPES, choose_topics, element_of, frames_of
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

LARGEST_PAGE = 65536  # bytes; SQLite writes it as 1
# How the messages about damaged recordings begin.
DAMAGED = "the recording cannot be read, it may be cut off or still being written"
REPAIR = {
    ".bag": "A ROS 1 bag without its index can be repaired with: rosbag reindex.",
    ".mcap": "What an MCAP file still holds can be saved with: mcap recover FILE.mcap --output WHOLE.mcap.",
}


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a recording of ROS topics onto one clock; header stamps count from the start of the recording."""
    options = settings.columns.bag
    with _opened(path) as bag:
        topics, remarks = choose_topics({c.topic: c.msgtype for c in bag.connections if c.msgcount}, options)
        unsaid = "tracker_cp" not in topics and options.topics.get("tracker_cp", options.tracker_topic) is None
        recorded, unread = _record(bag, topics, unsaid=unsaid)
        origin = bag.start_time
    recorded, names, moved = in_one_order(recorded)
    remarks, streams, meta = [*remarks, *unread, *moved], list[Stream](), LogMeta()
    for kind, messages in recorded.items():
        found, said, stated = streams_of(kind, messages, origin, options.clock, options.arm)
        meta = stated or meta
        streams += found
        remarks += said
    log = combine(streams, options.base, options.max_gap, shifts=options.shifts, disorder=settings.disorder)
    return replace(log, meta=replace(meta, joint_names=names), remarks=(*remarks, *log.remarks))


def topics_of(path: Path) -> tuple[list[tuple[str, str, int, float]], dict[str, int]]:
    """Topics of a recording, each with its type of message, how many there are, and their rate in Hz; moving frames.

    The pairs of frames whose transform moves come with the number of their messages.

    Parameters
    ----------
    path : Path
    """
    with _opened(path) as bag:
        seconds = (bag.end_time - bag.start_time) / 1e9
        used = sorted((c for c in bag.connections if c.msgcount), key=lambda c: c.topic)
        rate = 1.0 / seconds if seconds > 0 else 0.0
        topics = [(c.topic, c.msgtype, c.msgcount, (c.msgcount - 1) * rate) for c in used]
        tree, transforms = _Tree(), [c for c in used if c.msgtype in TF_TYPES]
        for connection, receive, raw in bag.messages(connections=transforms) if transforms else ():
            message = bag.deserialize(raw, connection.msgtype)
            tree.add(message, receive, static=connection.topic.endswith("tf_static"))
    return topics, {r.topic: len(r.rows) for _, r in tree.edges.values() if r.topic in tree.moving()}


def _record(bag: AnyReader, topics: Mapping[str, str], *, unsaid: bool) -> tuple[dict[str, Recorded], list[str]]:
    """Messages of the chosen sources, by kind, and a remark on transforms that move and may be what is missing.

    Transforms are read where a pair of frames, or nothing, was chosen, and where nobody said which the tracker is.
    """
    types = {c.topic: c.msgtype for c in bag.connections}
    recorded: dict[str, list[Recorded]] = {}
    kinds: dict[str, Recorded] = {}
    for kind, source in topics.items():
        topic, place = element_of(source)
        if not frames_of(source):
            kinds[kind] = Recorded(source, extractor(kind, types[topic], place))
            recorded.setdefault(topic, []).append(kinds[kind])
    tree = _Tree()
    wanted = unsaid or not topics or any(frames_of(source) for source in topics.values())
    connections = [c for c in bag.connections if c.topic in recorded or (wanted and c.msgtype in TF_TYPES)]
    for connection, receive, raw in bag.messages(connections=connections):
        message = bag.deserialize(raw, connection.msgtype)
        if connection.topic in recorded:
            for one in recorded[connection.topic]:
                one.add(message, receive)
        else:
            tree.add(message, receive, static=connection.topic.endswith("tf_static"))
    remarks = tree.remarks() if topics and unsaid else []
    topics = topics or {"tracker_cp": tree.only_moving()}
    for kind, source in topics.items():
        pair = frames_of(source)
        if pair:
            kinds[kind] = tree.pose(*pair)
    return {kind: kinds[kind] for kind in kinds if kinds[kind].rows}, remarks


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
        kind = ".mcap" if any(path.glob("*.mcap")) else path.suffix
        raise LogError(f"{DAMAGED}: {str(error).rstrip('.')}.", hint=REPAIR.get(kind, "")) from error


def _check_length(database: Path) -> None:
    """Refuse a database shorter than its header says: one that lost its last pages may still open."""
    with database.open("rb") as file:
        head = file.read(32)
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    expected = (LARGEST_PAGE if page == 1 else page) * pages
    if database.stat().st_size < expected:
        raise LogError(f"{DAMAGED}: expected {expected} bytes, found {database.stat().st_size}.")


@dataclass
class _Tree:
    """Transforms that ROS nodes publish on /tf and /tf_static, by child frame, as they are read."""

    edges: dict[str, tuple[str, Recorded]] = field(default_factory=dict)  # parent and poses of each child
    still: set[str] = field(default_factory=set)  # children whose transform was published as static
    torn: dict[str, str] = field(default_factory=dict)  # children that were given another parent too, and which

    def add(self, message: Any, receive: int, *, static: bool) -> None:
        """Add the transforms of a TFMessage that was received so many ns since 1970, on /tf_static or not."""
        for transform in message.transforms:
            child = transform.child_frame_id.strip("/")
            parent = transform.header.frame_id.strip("/")
            if child not in self.edges:
                self.edges[child] = (parent, Recorded(_source_name(parent, child), pose_row))
            elif self.edges[child][0] != parent:
                self.torn[child] = parent
                continue
            self.edges[child][1].add(transform, receive)
            if static:
                self.still.add(child)

    def moving(self) -> list[str]:
        """Pairs of neighbouring frames that move, named as a source."""
        return [
            _source_name(parent, child)
            for child, (parent, recorded) in self.edges.items()
            if child not in self.still and len(set(recorded.rows)) > 1
        ]

    def only_moving(self) -> str:
        """Return the pair of frames that moves; LogError where there is another number of them."""
        moving = self.moving()
        if len(moving) != 1:
            hint = "Choose one, or any pair of frames: --tracker-topic '/tf:base->tool' (in Python tracker_topic)."
            raise LogError(f"expected one moving transform, found {', '.join(moving) or 'none'}.", hint=hint)
        return moving[0]

    def remarks(self) -> list[str]:
        """Return which transforms move, beside topics that hold no tracker."""
        moving = self.moving()
        if not moving:
            return []
        choice = f'name it: --tracker-topic "{moving[0]}" (in Python tracker_topic)'
        return [
            f"no tracker was read; transforms that move: {', '.join(moving)}. If one is what a tracker saw, {choice}."
        ]

    def pose(self, parent: str, child: str) -> Recorded:
        """Pose of one frame in another at the stamps of the moving transform between them that is published most."""
        up, down = self._to_root(parent), self._to_root(child)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            known = sorted({*self.edges, *(p for p, _ in self.edges.values())})
            raise LogError(f"no transforms lead from {parent} to {child}.", hint=f"Frames here: {', '.join(known)}.")
        up, down = up[: up.index(common)], down[: down.index(common)]
        for frame in (*down, *up):
            if frame in self.torn:
                hint = "Two nodes publish it, or it was attached anew: record one of them, or name a pose's own topic."
                raise LogError(f"{frame} has two parents, {self.edges[frame][0]} and {self.torn[frame]}.", hint=hint)
        moving = [frame for frame in (*down, *up) if frame not in self.still]
        if not moving:
            hint = f"What moves: {', '.join(self.moving())}."
            raise LogError(f"nothing moves between {parent} and {child}.", hint=hint)
        lead = self.edges[max(moving, key=lambda frame: len(self.edges[frame][1].rows))][1]
        found = Recorded(_source_name(parent, child), pose_row, list(lead.stamp), list(lead.receive), list(lead.rows))
        if (up, down) != ([], [child]) or lead is not self.edges[child][1]:
            found.rows = self._composed(up, down, np.array(lead.stamp))
        return found

    def _to_root(self, frame: str) -> list[str]:
        """Return the frame and those above it."""
        path = [frame]
        while path[-1] in self.edges and self.edges[path[-1]][0] not in path:
            path.append(self.edges[path[-1]][0])
        return path

    def _composed(self, up: list[str], down: list[str], stamp: Any) -> list[tuple[float, ...]]:
        """Poses at these stamps, NaN where one of the transforms has a gap."""
        below = above = np.broadcast_to(np.eye(4), (len(stamp), 4, 4))
        for frame in reversed(down):
            below = below @ self._at(frame, stamp)
        for frame in reversed(up):
            above = above @ self._at(frame, stamp)
        T = se3.invert(above) @ below
        rows = np.full((len(stamp), 7), np.nan)
        seen = np.isfinite(T).all(axis=(1, 2))
        rows[seen] = np.hstack(se3.to_parts(T[seen]))
        return [tuple(row) for row in rows.tolist()]

    def _at(self, frame: str, stamp: Any) -> FloatArray:
        """Poses `(n, 4, 4)` of a frame in its parent; NaN in gaps."""
        recorded = self.edges[frame][1]
        rows = np.array(recorded.rows, dtype=np.float64)
        if frame in self.still:
            return np.broadcast_to(se3.from_parts(rows[-1, :3], rows[-1, 3:]), (len(stamp), 4, 4))
        origin = int(stamp[0])
        stream = Stream("tf", (np.array(recorded.stamp) - origin) / 1e9, PoseSignal.of(rows))
        pose = cast(PoseSignal, interpolate(stream, (stamp - origin) / 1e9))
        return se3.from_parts(pose.position, np.asarray(pose.quaternion))


def _source_name(parent: str, child: str) -> str:
    """Write a pair of frames as users name it, such as `/tf:base->tool`."""
    return f"/tf:{parent.strip('/')}->{child.strip('/')}"
