"""What the tests of the log readers share: small logs, and recordings of twelve ticks with a planted pose at each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

NATIVE = "time,trajectory,tracker_cp_x,tracker_cp_y,tracker_cp_z\n"


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


START = 1_700_000_000_123_456_789  # ns since 1970: a recording's first message
STEP = 10_000_000  # ns
N = 12
POSE = random_pose(np.random.default_rng(0), N)
TICKS = [START + k * STEP for k in range(N)]
Fields = dict[str, Any]


@dataclass(frozen=True)
class Post:
    """A message to put into a recording."""

    topic: str
    msgtype: str
    receive: int
    make: Callable[[Any], Any]


def header(types: Any, stamp: int, frame: str = "base") -> Any:
    """Make a header with a stamp in ns, of ROS 1 or ROS 2."""
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    kind = types["std_msgs/msg/Header"]
    return kind(seq=0, stamp=time, frame_id=frame) if "seq" in kind.__annotations__ else kind(time, frame)


def message(topic: str, msgtype: str, stamp: int, receive: int | None, fill: Callable[[Any], Fields]) -> Post:
    """Make a message of any type from its fields; `fill` is given the types, and the header comes first."""

    def make(types: Any) -> Any:
        given = fill(types)
        names = types[msgtype].__annotations__
        head = {"header": header(types, stamp)} if "header" in names else {}
        return types[msgtype](**head, **given)

    return Post(topic, msgtype, stamp if receive is None else receive, make)


def plain_pose(types: Any, position: Sequence[float], wxyz: Sequence[float]) -> Any:
    """Make a Pose, without a header."""
    w, x, y, z = wxyz
    point = types["geometry_msgs/msg/Point"](*position)
    return types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](x, y, z, w))


def plain_transform(types: Any, position: Sequence[float], wxyz: Sequence[float]) -> Any:
    """Make a Transform, without a header."""
    w, x, y, z = wxyz
    moved = types["geometry_msgs/msg/Vector3"](*position)
    return types["geometry_msgs/msg/Transform"](moved, types["geometry_msgs/msg/Quaternion"](x, y, z, w))


def pose_stamped(
    topic: str, position: Sequence[float], wxyz: Sequence[float], stamp: int, receive: int | None = None
) -> Post:
    """Make a PoseStamped message."""
    kind = "geometry_msgs/msg/PoseStamped"
    return message(topic, kind, stamp, receive, lambda types: {"pose": plain_pose(types, position, wxyz)})


def transform_stamped(
    topic: str, position: Sequence[float], wxyz: Sequence[float], stamp: int, receive: int | None = None
) -> Post:
    """Make a TransformStamped message."""

    def fill(types: Any) -> Fields:
        return {"child_frame_id": "marker", "transform": plain_transform(types, position, wxyz)}

    return message(topic, "geometry_msgs/msg/TransformStamped", stamp, receive, fill)


def transforms(topic: str, pairs: Sequence[tuple[str, str, Sequence[float], Sequence[float]]], stamp: int) -> Post:
    """Make a TFMessage of (parent, child, position, quaternion wxyz)."""

    def fill(types: Any) -> Fields:
        kind = types["geometry_msgs/msg/TransformStamped"]
        return {
            "transforms": [
                kind(header(types, stamp, parent), child, plain_transform(types, position, wxyz))
                for parent, child, position, wxyz in pairs
            ]
        }

    return message(topic, "tf2_msgs/msg/TFMessage", stamp, None, fill)


def joint_state(
    topic: str, position: FloatArray, stamp: int, *, velocity: FloatArray | None = None, names: str = "abcdef"
) -> Post:
    """Make a JointState message; efforts are ten times the velocities."""
    v = np.zeros(0) if velocity is None else np.asarray(velocity, dtype=np.float64)
    values = np.asarray(position, dtype=np.float64)
    fields = {"name": list(names[: len(position)]), "position": values, "velocity": v, "effort": 10 * v}
    return message(topic, "sensor_msgs/msg/JointState", stamp, None, lambda types: fields)


def poses(topic: str, make: Callable[..., Post] = pose_stamped, late: int = 0) -> list[Post]:
    """Make a message of the planted pose of each tick."""
    return [make(topic, POSE.position[k], POSE.quaternion[k], t + late) for k, t in enumerate(TICKS)]


def moving(parent: str, child: str) -> list[Post]:
    """Make a transform of the planted pose of each tick."""
    return [transforms("/tf", [(parent, child, POSE.position[k], POSE.quaternion[k])], t) for k, t in enumerate(TICKS)]


def counted(topic: str, stamps: Sequence[int] = TICKS, receives: Sequence[int | None] | None = None) -> list[Post]:
    """Make a pose of each stamp whose x is its place, received at its stamp unless it is said when."""
    came = receives if receives is not None else [None] * len(stamps)
    return [pose_stamped(topic, [k, 0, 0], [1, 0, 0, 0], stamp, came[k]) for k, stamp in enumerate(stamps)]


def write_bag(path: Path, posts: Sequence[Post], kind: str, definitions: Sequence[tuple[str, str]] = ()) -> Path:
    """Write a recording and give the path to read: kind "bag", "mcap", "db3", or "folder"."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    for name, text in definitions:
        store.register(get_types_from_msg(text, name))
    if kind == "bag":
        target, serialize = path.with_suffix(".bag"), store.serialize_ros1
        writer: Any = rosbag1.Writer(target)
    else:
        target, serialize = path, store.serialize_cdr
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    with writer:
        links: dict[str, Any] = {}
        for post in sorted(posts, key=lambda p: p.receive):
            if post.topic not in links:
                links[post.topic] = writer.add_connection(post.topic, post.msgtype, typestore=store)
            raw = serialize(post.make(store.types), post.msgtype)
            writer.write(links[post.topic], post.receive, raw)
    return target if kind in ("bag", "folder") else next(target.glob(f"*.{kind}"))
