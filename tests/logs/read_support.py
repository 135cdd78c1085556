"""What the tests of the log readers share: small logs and recordings with planted values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

NATIVE = "time,trajectory,tracker_cp_x,tracker_cp_y,tracker_cp_z\n"
START = 1_700_000_000_123_456_789  # ns since 1970: a recording's first message


def write(path: Path, text: str | bytes) -> Path:
    """Write a file as it is and give its path."""
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def random_pose(rng: np.random.Generator, n: int) -> PoseSignal:
    """Draw poses without any order."""
    return PoseSignal(rng.normal(size=(n, 3)), Rotation.random(n, rng=rng).as_quat(scalar_first=True))


def random_log(seed: int, n: int = 20, dof: int = 6) -> CalibrationLog:
    """Make a log with every signal, gaps in some, and meta data."""
    rng = np.random.default_rng(seed)
    tracker = random_pose(rng, n)
    position, quaternion = np.array(tracker.position), np.array(tracker.quaternion)
    position[3], quaternion[3] = np.nan, np.nan
    joints = {name: rng.normal(size=(n, dof)) for name in CalibrationLog.JOINTS}
    joints["measured_jf"][5, 2] = np.nan
    return CalibrationLog(
        np.cumsum(rng.uniform(0.01, 0.02, n)),
        np.repeat([7, 2], [n // 2, n - n // 2]),
        np.full(n, 3),
        setpoint_cp=random_pose(rng, n),
        measured_cp=random_pose(rng, n),
        tracker_cp=PoseSignal(position, quaternion),
        **joints,
        payload=rng.uniform(0, 1, n),
        temperature=rng.uniform(20, 30, n),
        extra={"grip, force": rng.normal(size=n), "empty": np.full(n, np.nan)},
        meta=LogMeta(
            robot="RAVEN-II",
            notes='quotes " and \\ and\nlines, µ 😀 \x7f',
            tracker_base=(0.1, -0.2, 1 / 3, 0.0, 1e-17, np.pi / 2),
        ),
    )


def assert_same_log(a: CalibrationLog, b: CalibrationLog) -> None:
    """Assert that logs are equal in every number, NaN for NaN, and in the meta data."""
    assert a.signals == b.signals
    assert a.extra.keys() == b.extra.keys()
    for name in ("time", "trajectory", "session", *a.signals):
        left, right = getattr(a, name), getattr(b, name)
        if isinstance(left, PoseSignal):
            np.testing.assert_array_equal(left.position, right.position)
            np.testing.assert_array_equal(left.quaternion, right.quaternion)
        else:
            np.testing.assert_array_equal(left, right)
    for name, values in a.extra.items():
        np.testing.assert_array_equal(values, b.extra[name])
    assert a.meta == b.meta


@dataclass(frozen=True)
class Post:
    """A message to put into a recording."""

    topic: str
    msgtype: str
    receive: int
    make: Callable[[Any], Any]


def header(types: Any, stamp: int) -> Any:
    """Make a header with a stamp in ns, of ROS 1 or ROS 2."""
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    kind = types["std_msgs/msg/Header"]
    return kind(seq=0, stamp=time, frame_id="base") if "seq" in kind.__annotations__ else kind(time, "base")


def pose_stamped(
    topic: str, position: Sequence[float], wxyz: Sequence[float], stamp: int, receive: int | None = None
) -> Post:
    """Make a PoseStamped message."""

    def make(types: Any) -> Any:
        w, x, y, z = wxyz
        point = types["geometry_msgs/msg/Point"](*position)
        pose = types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](x, y, z, w))
        return types["geometry_msgs/msg/PoseStamped"](header(types, stamp), pose)

    return Post(topic, "geometry_msgs/msg/PoseStamped", stamp if receive is None else receive, make)


def transform_stamped(
    topic: str, position: Sequence[float], wxyz: Sequence[float], stamp: int, receive: int | None = None
) -> Post:
    """Make a TransformStamped message."""

    def make(types: Any) -> Any:
        w, x, y, z = wxyz
        moved = types["geometry_msgs/msg/Vector3"](*position)
        transform = types["geometry_msgs/msg/Transform"](moved, types["geometry_msgs/msg/Quaternion"](x, y, z, w))
        return types["geometry_msgs/msg/TransformStamped"](header(types, stamp), "marker", transform)

    return Post(topic, "geometry_msgs/msg/TransformStamped", stamp if receive is None else receive, make)


def message(topic: str, msgtype: str, stamp: int, receive: int, fill: Callable[[Any], dict[str, Any]]) -> Post:
    """Make a message of any type from its fields; `fill` is given the types, and the header comes first."""

    def make(types: Any) -> Any:
        given = fill(types)
        names = types[msgtype].__annotations__
        head = {"header": header(types, stamp)} if "header" in names else {}
        return types[msgtype](**head, **given)

    return Post(topic, msgtype, receive, make)


def plain_pose(types: Any, position: Sequence[float], wxyz: Sequence[float]) -> Any:
    """Make a Pose, without a header."""
    w, x, y, z = wxyz
    point = types["geometry_msgs/msg/Point"](*position)
    return types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](x, y, z, w))


def transforms(topic: str, pairs: Sequence[tuple[str, str, Sequence[float], Sequence[float]]], stamp: int) -> Post:
    """Make a TFMessage of (parent, child, position, quaternion wxyz)."""

    def make(types: Any) -> Any:
        made = []
        for parent, child, position, (w, x, y, z) in pairs:
            head = header(types, stamp)
            head.frame_id = parent
            moved = types["geometry_msgs/msg/Vector3"](*position)
            turned = types["geometry_msgs/msg/Quaternion"](x, y, z, w)
            transform = types["geometry_msgs/msg/Transform"](moved, turned)
            made.append(types["geometry_msgs/msg/TransformStamped"](head, child, transform))
        return types["tf2_msgs/msg/TFMessage"](made)

    return Post(topic, "tf2_msgs/msg/TFMessage", stamp, make)


def joint_state(
    topic: str, position: FloatArray, stamp: int, *, velocity: FloatArray | None = None, names: str = "abcdef"
) -> Post:
    """Make a JointState message; efforts are ten times the velocities."""

    def make(types: Any) -> Any:
        v = np.zeros(0) if velocity is None else np.asarray(velocity, dtype=np.float64)
        joints = list(names[: len(position)])
        values = np.asarray(position, dtype=np.float64)
        return types["sensor_msgs/msg/JointState"](header(types, stamp), joints, values, v, 10 * v)

    return Post(topic, "sensor_msgs/msg/JointState", stamp, make)


def write_bag(path: Path, posts: Sequence[Post], kind: str, definitions: Sequence[tuple[str, str]] = ()) -> Path:
    """Write a recording and give the path to read: kind "bag", "mcap", "db3", or "folder"."""
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Ros2Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    for name, text in definitions:
        store.register(get_types_from_msg(text, name))
    if kind == "bag":
        target, writer, serialize = (
            path.with_suffix(".bag"),
            Ros1Writer(path.with_suffix(".bag")),
            store.serialize_ros1,
        )
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        target, writer, serialize = (
            path,
            Ros2Writer(path, version=9, storage_plugin=plugin),
            store.serialize_cdr,
        )
    with writer:
        links: dict[str, Any] = {}
        for post in sorted(posts, key=lambda p: p.receive):
            if post.topic not in links:
                links[post.topic] = writer.add_connection(post.topic, post.msgtype, typestore=store)
            raw = serialize(post.make(store.types), post.msgtype)
            writer.write(links[post.topic], post.receive, raw)
    return target if kind in ("bag", "folder") else next(target.glob(f"*.{kind}"))
