"""What of a ROS recording is read: messages that hold a pose, transforms, names without a slash, topics by choice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from read_support import (
    POSE,
    TICKS,
    N,
    Post,
    joint_state,
    message,
    moving,
    plain_pose,
    poses,
    random_pose,
    transform_stamped,
    transforms,
    write,
    write_bag,
)
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog

KINDS = pytest.mark.parametrize("kind", ["bag", "mcap"])
COVARIANCE = np.zeros(36)


def planted(k: int, types: Any) -> Any:
    return plain_pose(types, POSE.position[k], POSE.quaternion[k])


def with_covariance(k: int, types: Any) -> Any:
    return types["geometry_msgs/msg/PoseWithCovariance"](planted(k, types), COVARIANCE)


def odometry(k: int, types: Any) -> dict[str, Any]:
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](zero, zero), COVARIANCE)
    return {"child_frame_id": "tool", "pose": with_covariance(k, types), "twist": twist}


def array(k: int, types: Any) -> dict[str, Any]:
    return {"poses": [plain_pose(types, [9, 9, 9], [1, 0, 0, 0]), planted(k, types)]}


def posts(topic: str, msgtype: str, fill: Any) -> list[Post]:
    return [message(topic, msgtype, t, t, lambda types, k=k: fill(k, types)) for k, t in enumerate(TICKS)]


FORMS = {
    "odometry": ("nav_msgs/msg/Odometry", odometry),
    "covariance": ("geometry_msgs/msg/PoseWithCovarianceStamped", lambda k, t: {"pose": with_covariance(k, t)}),
    "array of one": ("geometry_msgs/msg/PoseArray", lambda k, t: {"poses": [planted(k, t)]}),
    "no header": (
        "geometry_msgs/msg/Pose",
        lambda k, t: {"position": planted(k, t).position, "orientation": planted(k, t).orientation},
    ),
}


def assert_planted(log: CalibrationLog) -> None:
    np.testing.assert_array_equal(log.tracker_cp.position, POSE.position)
    np.testing.assert_array_equal(log.tracker_cp.quaternion, POSE.quaternion)
    np.testing.assert_allclose(log.time, np.arange(N) / 100, atol=1e-12)


@KINDS
@pytest.mark.parametrize("form", FORMS)
def test_whatever_message_holds_the_pose_it_is_the_same(tmp_path: Path, kind: str, form: str):
    """Bit for bit, and taken for the tracker where it is the only one."""
    assert_planted(read_log(write_bag(tmp_path / "r", posts("/tool", *FORMS[form]), kind)))


@KINDS
def test_a_point_is_a_position_only(tmp_path: Path, kind: str):
    """PointStamped has no orientation: none is made up."""
    points = posts("/p", "geometry_msgs/msg/PointStamped", lambda k, t: {"point": planted(k, t).position})
    log = read_log(write_bag(tmp_path / "r", points, kind))
    np.testing.assert_array_equal(log.tracker_cp.position, POSE.position)
    assert log.tracker_cp.quaternion is None


def test_a_pose_of_an_array_is_chosen_by_its_place(tmp_path: Path):
    """Several poses and no choice is refused with the way to choose."""
    bag = write_bag(tmp_path / "r", posts("/poses", "geometry_msgs/msg/PoseArray", array), "mcap")
    with pytest.raises(LogError, match=r"holds 2 poses.*/poses\[1\]"):
        read_log(bag)
    assert_planted(read_log(bag, tracker_topic="/poses[1]"))


def test_a_stamped_pose_comes_before_other_messages(tmp_path: Path):
    """A recording that was read before other types were known is still read the same."""
    other = posts("/base/odom", "nav_msgs/msg/Odometry", odometry)
    plain = poses("/tool")
    log = read_log(write_bag(tmp_path / "r", plain + other, "bag"))
    assert log.remarks == ("/tool was taken for the tracker.",)


def test_topics_without_a_leading_slash_are_the_same_topics(tmp_path: Path):
    """Robot, namespace, tracker and choice."""
    seen = poses("ndi/tool")
    told = poses("PSM1/setpoint_cp")
    bag = write_bag(tmp_path / "r", seen + told, "mcap")
    for log in (read_log(bag), read_log(bag, tracker_topic="/ndi/tool"), read_log(bag, namespace="/PSM1")):
        assert log.signals == ("setpoint_cp", "tracker_cp")
        assert_planted(log)


def test_a_mapping_says_which_topic_is_which_signal(tmp_path: Path):
    """Names that follow no convention; a topic that holds something else is refused."""
    q = np.random.default_rng(1).normal(size=(N, 3))
    told = poses("/goal")
    joints = [joint_state("/joint_states", q[k], t) for k, t in enumerate(TICKS)]
    seen = poses("/eye")
    bag = write_bag(tmp_path / "r", told + joints + seen, "bag")
    text = '[bag.topics]\nsetpoint_cp = "goal"\nmeasured_js = "/joint_states"\ntracker_cp = "/eye"\n'
    log = read_log(bag, columns=write(tmp_path / "m.toml", text))
    assert log.signals == ("setpoint_cp", "tracker_cp", "measured_jp")
    assert_planted(log)
    np.testing.assert_array_equal(log.measured_jp, q)
    with pytest.raises(LogError, match=r"no pose topic /joint_states.*Pose topics here: /goal, /eye"):
        read_log(bag, columns=write(tmp_path / "m.toml", text.replace("/eye", "/joint_states")))


@KINDS
def test_the_only_moving_transform_is_the_tracker(tmp_path: Path, kind: str):
    """Fixed ones beside it do not matter."""
    moved = moving("world", "tool")
    fixed = transforms("/tf_static", [("tool", "tip", [0, 0, 0.1], [1, 0, 0, 0])], TICKS[0])
    unknown = [("tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms")] if kind == "bag" else []
    assert_planted(read_log(write_bag(tmp_path / "r", [*moved, fixed], kind, unknown)))


def test_transforms_beside_a_robot_without_a_tracker_are_named(tmp_path: Path):
    """A tracker on /tf beside CRTK topics was left out without a word."""
    told = poses("/PSM1/setpoint_cp")
    seen = moving("camera", "tool")
    bag = write_bag(tmp_path / "r", told + seen, "mcap")
    log = read_log(bag)
    assert log.tracker_cp is None
    assert any('--tracker-topic "/tf:camera->tool"' in remark for remark in log.remarks)
    named = read_log(bag, tracker_topic="/tf:camera->tool")
    assert_planted(named)
    for settled in (named, read_log(bag, tracker_topic="")):
        assert not any("transforms that move" in remark for remark in settled.remarks)


def test_the_pose_between_any_two_frames_is_the_product_of_the_transforms(tmp_path: Path):
    """Up one branch and down the other, fixed and moving; a slower one is interpolated."""
    arm, base = random_pose(np.random.default_rng(2), 1), random_pose(np.random.default_rng(3), 1)
    fixed = transforms(
        "/tf_static",
        [("world", "base", base.position[0], base.quaternion[0]), ("link", "tip", arm.position[0], arm.quaternion[0])],
        TICKS[0],
    )
    moved = moving("base", "link")
    slow = [
        transforms("/tf", [("world", "camera", [k / 10, 0, 0], [1, 0, 0, 0])], t)
        for k, t in enumerate(TICKS)
        if k in (0, 4, 8, 11)
    ]
    bag = write_bag(tmp_path / "r", [*moved, fixed, *slow], "mcap")
    with pytest.raises(LogError, match=r"one moving transform, found /tf:base->link, /tf:world->camera"):
        read_log(bag)
    log = read_log(bag, tracker_topic="/tf:camera->tip")

    def matrix(position: Any, quaternion: Any) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position
        return T

    for k in range(N):
        camera = matrix([k / 10, 0, 0], [1, 0, 0, 0])
        whole = (matrix(base.position[0], base.quaternion[0]), matrix(POSE.position[k], POSE.quaternion[k]))
        expected = np.linalg.inv(camera) @ whole[0] @ whole[1] @ matrix(arm.position[0], arm.quaternion[0])
        np.testing.assert_allclose(
            matrix(log.tracker_cp.position[k], log.tracker_cp.quaternion[k]), expected, atol=1e-9
        )
    again = [transforms("/tf", [("world", "link", POSE.position[0], POSE.quaternion[0])], TICKS[6])]
    torn = write_bag(tmp_path / "torn", [*moved, fixed, *again], "mcap")
    with pytest.raises(LogError, match="link has two parents, base and world"):  # what came before was dropped
        read_log(torn, tracker_topic="/tf:base->tip")
    with pytest.raises(LogError, match=r"no transforms lead from world to nowhere.*base, camera, link, tip, world"):
        read_log(bag, tracker_topic="/tf:world->nowhere")
    with pytest.raises(LogError, match="nothing moves between world and base"):
        read_log(bag, tracker_topic="/tf:world->base")


@pytest.mark.parametrize("name", ["frame_id", "child_frame_id"])
def test_poses_of_two_bodies_under_one_topic_are_not_mixed(tmp_path: Path, name: str):
    """They were read as one body that jumps from one place to the other."""

    def post(k: int) -> Post:
        whole = transform_stamped("/ndi/tools", POSE.position[k], POSE.quaternion[k], TICKS[k])

        def make(types: Any) -> Any:
            made = whole.make(types)
            setattr(made.header if name == "frame_id" else made, name, ["left", "/left", "right"][k % 3] if k else "")
            return made

        return Post(whole.topic, whole.msgtype, whole.receive, make)

    one = [post(k) for k in range(N) if k % 3 < 2]
    assert len(read_log(write_bag(tmp_path / "one", one, "mcap"))) == len(one)
    with pytest.raises(LogError, match=r"/ndi/tools holds poses of several bodies .*left.*right"):
        read_log(write_bag(tmp_path / "two", [post(k) for k in range(N)], "mcap"))


def test_joint_states_that_are_not_read_are_named(tmp_path: Path):
    """A robot that follows no CRTK names was left out without a word."""
    joints = [joint_state("/joint_states", POSE.position[k], t) for k, t in enumerate(TICKS)]
    tracker = poses("/ndi/tool")
    log = read_log(write_bag(tmp_path / "r", joints + tracker, "mcap"))
    assert log.signals == ("tracker_cp",)
    assert any("/joint_states" in remark and "[bag.topics]" in remark for remark in log.remarks)
    whose = write(tmp_path / "m.toml", '[bag.topics]\nmeasured_js = "joint_states"\n')
    assert "measured_jp" in read_log(tmp_path / "r", columns=whose).signals
