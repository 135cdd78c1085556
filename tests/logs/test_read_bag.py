from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from read_support import (
    POSE,
    START,
    STEP,
    TICKS,
    N,
    Post,
    counted,
    joint_state,
    pose_stamped,
    poses,
    transform_stamped,
    write,
    write_bag,
)
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs import join_logs, read_log, rosbag, write_log
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.order import Disorder
from gpcorrect.types import CalibrationLog

KINDS = ("bag", "mcap", "db3", "folder")
JOINTS = np.random.default_rng(1).normal(size=(N, 6))
SPEEDS = np.random.default_rng(2).normal(size=(N, 6))


def robot(space: str = "/PSM1", make: Callable[..., Post] = pose_stamped) -> list[Post]:
    measured = [joint_state(f"{space}/measured_js", JOINTS[k], t, velocity=SPEEDS[k]) for k, t in enumerate(TICKS)]
    setpoint = [joint_state(f"{space}/setpoint_js", -JOINTS[k], t) for k, t in enumerate(TICKS)]
    return [*measured, *setpoint, *poses(f"{space}/setpoint_cp", make), *poses(f"{space}/measured_cp", make)]


def test_poses_of_a_bag_are_scaled_by_its_mapping(tmp_path: Path):
    path = write_bag(tmp_path / "r", robot() + poses("/ndi/tool", pose_stamped), "mcap")
    log = read_log(path, columns=write(tmp_path / "m.toml", "[tracker_cp]\nposition_scale = 1e-3\n"))
    np.testing.assert_allclose(1e3 * log.tracker_cp.position, POSE.position, rtol=1e-12)
    np.testing.assert_array_equal(log.setpoint_cp.position, POSE.position)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", [pose_stamped, transform_stamped])
def test_planted_values_are_read_back_bit_for_bit(tmp_path: Path, kind: str, make: Callable[..., Post]):
    log = read_log(write_bag(tmp_path / "r", robot(make=make) + poses("/ndi/tool", make), kind))
    assert log.signals == (
        "setpoint_cp",
        "measured_cp",
        "tracker_cp",
        "setpoint_jp",
        "measured_jp",
        "measured_jv",
        "measured_jf",
    )
    np.testing.assert_array_equal(log.time, np.arange(N) * STEP / 1e9)
    for name in log.POSES:
        np.testing.assert_array_equal(getattr(log, name).position, POSE.position)
        np.testing.assert_array_equal(getattr(log, name).quaternion, POSE.quaternion)
    np.testing.assert_array_equal(log.measured_jp, JOINTS)
    np.testing.assert_array_equal(log.setpoint_jp, -JOINTS)
    np.testing.assert_array_equal(log.measured_jv, SPEEDS)
    np.testing.assert_array_equal(log.measured_jf, 10 * SPEEDS)
    assert log.remarks == ("/ndi/tool was taken for the tracker.",)
    assert len(log.digest) == 64


def test_a_topic_between_two_others_is_interpolated_and_never_rounded_to_the_nearest(tmp_path: Path):
    turn = Rotation.from_rotvec([[0, 0, 0.1 * k] for k in range(N)]).as_quat(scalar_first=True)
    moving = [pose_stamped("/p/setpoint_cp", [k, 0, 0], turn[k], t) for k, t in enumerate(TICKS)]
    seen = [pose_stamped("/tracker", [0, 0, k], [1, 0, 0, 0], t + STEP // 4) for k, t in enumerate(TICKS[:-1])]
    log = read_log(write_bag(tmp_path / "r", moving + seen, "bag"))
    np.testing.assert_array_equal(log.tracker_cp.position[:, 2], np.arange(N - 1))
    np.testing.assert_allclose(log.setpoint_cp.position[:, 0], np.arange(N - 1) + 0.25, atol=1e-9)
    angle = Rotation.from_quat(log.setpoint_cp.quaternion, scalar_first=True).magnitude()
    np.testing.assert_allclose(angle, 0.1 * (np.arange(N - 1) + 0.25), atol=1e-7)


def test_header_stamps_are_taken_unless_the_recorders_clock_is_asked_for(tmp_path: Path):
    late = 4_000_000
    posts = counted("/p/setpoint_cp", TICKS, [t + late for t in TICKS])
    bag = write_bag(tmp_path / "r", posts, "mcap")
    np.testing.assert_allclose(read_log(bag).time, (np.arange(N) * STEP - late) / 1e9)
    mapping = write(tmp_path / "m.toml", '[bag]\nclock = "receive"\n')
    np.testing.assert_array_equal(read_log(bag, columns=mapping).time, np.arange(N) * STEP / 1e9)


def test_times_of_reception_stand_in_for_stamps_of_zero_and_that_is_reported(tmp_path: Path):
    posts = counted("/p/setpoint_cp", [0] * N, TICKS)
    log = read_log(write_bag(tmp_path / "r", posts, "bag"))
    np.testing.assert_array_equal(log.time, np.arange(N) * STEP / 1e9)
    assert log.remarks == ("/p/setpoint_cp has no header stamps; the receive times were taken.",)


def test_single_messages_without_a_stamp_are_left_out_and_counted(tmp_path: Path):
    posts = counted("/p/setpoint_cp", [t * (k != 3) for k, t in enumerate(TICKS)], TICKS)
    log = read_log(write_bag(tmp_path / "r", posts, "bag"))
    assert log.setpoint_cp.position[:, 0].tolist() == [k for k in range(N) if k != 3]
    assert log.remarks == ("1 messages of /p/setpoint_cp without a stamp were left out.",)


def test_clocks_that_share_no_time_are_refused_and_a_shift_in_the_mapping_joins_them(tmp_path: Path):
    ahead = 10**12
    posts = robot() + [
        pose_stamped("/tracker", POSE.position[k], POSE.quaternion[k], t + ahead, t) for k, t in enumerate(TICKS)
    ]
    bag = write_bag(tmp_path / "r", posts, "mcap")
    with pytest.raises(LogError, match=r"share no time.*bag\.clock.*bag\.shifts"):
        read_log(bag)
    mapping = write(tmp_path / "m.toml", "[bag.shifts]\ntracker_cp = -1000.0\n")
    log = read_log(bag, columns=mapping)
    assert len(log) >= N - 1  # rounding may put the last stamp just outside
    np.testing.assert_allclose(log.setpoint_jp, -JOINTS[: len(log)], atol=1e-6)


def test_the_base_and_the_longest_gap_can_be_set_in_the_mapping(tmp_path: Path):
    slow = counted("/tracker")[::4]
    bag = write_bag(tmp_path / "r", robot() + slow, "bag")
    assert len(read_log(bag)) == 3
    mapping = write(tmp_path / "m.toml", '[bag]\nbase = "setpoint_jp"\nmax_gap = 0.04\n')
    whole = read_log(bag, columns=mapping)
    np.testing.assert_allclose(whole.tracker_cp.position[:9, 0], np.arange(9), atol=1e-9)
    mapping = write(tmp_path / "m.toml", '[bag]\nbase = "setpoint_jp"\nmax_gap = 0.03\n')
    assert np.isfinite(read_log(bag, columns=mapping).tracker_cp.position[:, 0]).sum() == 3


def test_joints_are_matched_by_name_and_not_by_place(tmp_path: Path):
    """Where a topic names the same joints in another order, its columns go where the first topic has them."""
    turned = [4, 2, 0, 5, 3, 1]
    names = "".join("abcdef"[k] for k in turned)
    sent = [joint_state("/p/setpoint_js", JOINTS[k], t) for k, t in enumerate(TICKS)]
    true = [joint_state("/p/external_js", 2 * JOINTS[k][turned], t, names=names) for k, t in enumerate(TICKS)]
    log = read_log(write_bag(tmp_path / "r", sent + true, "bag"))
    np.testing.assert_array_equal(log.external_jp, 2 * log.setpoint_jp)
    assert log.remarks == (
        "/p/external_js names its joints in another order than /p/setpoint_js: that of /p/setpoint_js was taken.",
    )
    other = [joint_state("/p/external_js", JOINTS[k], t, names="bcdefg") for k, t in enumerate(TICKS)]
    with pytest.raises(LogError, match="holds the joints a, b, c"):
        read_log(write_bag(tmp_path / "s", sent + other, "bag"))


def test_several_robots_must_be_chosen_from_by_namespace(tmp_path: Path):
    other = [joint_state("/PSM2/measured_js", JOINTS[k, :3], t) for k, t in enumerate(TICKS)]
    bag = write_bag(tmp_path / "r", robot() + other, "bag")
    with pytest.raises(LogError, match="several robots: /PSM1, /PSM2"):
        read_log(bag)
    assert read_log(bag, namespace="PSM2/").measured_jp.shape == (N, 3)
    mapping = write(tmp_path / "m.toml", '[bag]\nnamespace = "/PSM2"\n')
    assert read_log(bag, columns=mapping).measured_jp.shape == (N, 3)
    assert read_log(bag, columns=mapping, namespace="/PSM1").measured_jp.shape == (N, 6)
    with pytest.raises(LogError, match=r"no robot /PSM3\. Namespaces here: /PSM1, /PSM2"):
        read_log(bag, namespace="/PSM3")


def test_parts_of_a_robot_are_left_out_with_a_remark(tmp_path: Path):
    jaw = [joint_state("/PSM1/jaw/measured_js", JOINTS[k, :1], t) for k, t in enumerate(TICKS)]
    log = read_log(write_bag(tmp_path / "r", robot() + jaw, "bag"))
    np.testing.assert_array_equal(log.measured_jp, JOINTS)
    assert log.remarks == ("read /PSM1; its parts /PSM1/jaw were left out.",)


def test_topics_without_a_namespace_are_a_robot_too(tmp_path: Path):
    log = read_log(write_bag(tmp_path / "r", robot(space=""), "bag"))
    np.testing.assert_array_equal(log.measured_jp, JOINTS)


def test_a_tracker_is_found_by_its_name_chosen_or_left_out(tmp_path: Path):
    other = counted("/goal")
    bag = write_bag(tmp_path / "r", robot() + other + poses("/vicon/tool", transform_stamped), "bag")
    np.testing.assert_array_equal(read_log(bag).tracker_cp.position, POSE.position)
    np.testing.assert_array_equal(read_log(bag, tracker_topic="goal").tracker_cp.position[:, 0], np.arange(N))
    assert read_log(bag, tracker_topic="").tracker_cp is None
    with pytest.raises(LogError, match=r"no pose topic /none. Pose topics here: .*/vicon/tool"):
        read_log(bag, tracker_topic="/none")


def test_two_trackers_must_be_chosen_from(tmp_path: Path):
    both = poses("/vicon/a") + poses("/vicon/b")
    bag = write_bag(tmp_path / "r", robot() + both, "bag")
    with pytest.raises(LogError, match="more than one topic that may be the tracker: /vicon/a, /vicon/b"):
        read_log(bag)


def test_a_tracker_that_speaks_crtk_is_no_robot(tmp_path: Path):
    bag = write_bag(tmp_path / "r", robot() + poses("/atracsys/tool/measured_cp"), "bag")
    log = read_log(bag)
    np.testing.assert_array_equal(log.tracker_cp.position, POSE.position)
    np.testing.assert_array_equal(log.measured_jp, JOINTS)


def test_a_quaternion_far_from_unit_is_a_missing_rotation_and_counted(tmp_path: Path):
    posts = [pose_stamped("/p/measured_cp", [0, 0, 0], [float(k != 2), 0, 0, 0], t) for k, t in enumerate(TICKS)]
    log = read_log(write_bag(tmp_path / "r", posts, "bag"))
    assert np.flatnonzero(np.isnan(log.measured_cp.quaternion).any(axis=1)).tolist() == [2]
    assert "1 samples of measured_cp have no valid rotation" in log.remarks[0]


def test_joints_in_changing_order_are_matched_by_name_and_other_joints_refused(tmp_path: Path):
    turned = [1, 0, 2, 3, 4, 5]
    posts = [
        joint_state("/p/measured_js", JOINTS[k][turned if k % 3 else ...], t, names="bacdef" if k % 3 else "abcdef")
        for k, t in enumerate(TICKS)
    ]
    log = read_log(write_bag(tmp_path / "r", posts, "bag"))
    np.testing.assert_array_equal(log.measured_jp, JOINTS)
    assert "changing order" in log.remarks[0]
    posts[-1] = joint_state("/p/measured_js", JOINTS[-1], TICKS[-1], names="abcdeg")
    with pytest.raises(LogError, match="change from message to message: it names a, b, c, d, e, f and then a, b, c, d"):
        read_log(write_bag(tmp_path / "s", posts, "bag"))


def test_joint_names_are_kept_for_recordings_in_another_order(tmp_path: Path):
    """The same robot's joints, in another order in the second bag, were joined column by column without a word."""

    def recorded(place: Path, order: list[int], late: int) -> CalibrationLog:
        names = "".join("abcdef"[j] for j in order)
        posts = [joint_state("/p/setpoint_js", JOINTS[k][order], t + late, names=names) for k, t in enumerate(TICKS)]
        return read_log(write_bag(place, posts, "bag"))

    one, two = recorded(tmp_path / "r", [0, 1, 2, 3, 4, 5], 0), recorded(tmp_path / "s", [5, 4, 3, 2, 0, 1], 1)
    write_log(two, tmp_path / "two.csv")
    back = read_log(tmp_path / "two.csv")
    assert one.meta.joint_names == tuple("abcdef")
    assert back.meta.joint_names == tuple("fedcab")
    joined = join_logs([one, back])
    np.testing.assert_array_equal(joined.setpoint_jp, np.concatenate([JOINTS, JOINTS]))
    assert joined.meta.joint_names == tuple("abcdef")
    assert "by name in the order a, b, c, d, e, f; they came as f, e, d, c, a, b" in joined.remarks[-1]


def test_velocities_that_come_and_go_are_left_out_and_reported(tmp_path: Path):
    posts = [
        joint_state("/p/measured_js", JOINTS[k], t, velocity=SPEEDS[k] if k else None) for k, t in enumerate(TICKS)
    ]
    log = read_log(write_bag(tmp_path / "r", posts, "bag"))
    assert log.signals == ("measured_jp",)
    assert "measured_jv is left out" in log.remarks[0]


def test_a_recording_of_other_things_is_refused_with_its_topics(tmp_path: Path):
    posts = [joint_state("/joint_states", JOINTS[k], t) for k, t in enumerate(TICKS)]
    with pytest.raises(LogError, match=r"no CRTK, RAVEN-II or tracker topic.*/joint_states \(sensor_msgs"):
        read_log(write_bag(tmp_path / "r", posts, "bag"))


def test_backward_header_stamps_are_refused_or_dropped(tmp_path: Path):
    stamps = [*TICKS[:6], TICKS[2], *TICKS[7:]]
    posts = counted("/p/setpoint_cp", stamps, TICKS)
    bag = write_bag(tmp_path / "r", posts, "bag")
    with pytest.raises(LogError, match="/p/setpoint_cp run backwards, the first at sample 7"):
        read_log(bag)
    assert read_log(bag, disorder="drop").setpoint_cp.position[:, 0].tolist() == [k for k in range(N) if k != 6]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("disorder", ["refuse", "keep"])
def test_messages_received_out_of_order_are_sorted_by_their_stamps(tmp_path: Path, kind: str, disorder: Disorder):
    rng, ticks = np.random.default_rng(4), START + STEP * np.arange(60)
    stamps = (ticks + rng.integers(-STEP // 4, STEP // 4, 60)).tolist()
    came = np.argsort(np.arange(60) + rng.normal(scale=3, size=60)).tolist()
    posts = [
        pose_stamped("/p/setpoint_cp", [k, 0, 0], [1, 0, 0, 0], stamps[k], t)
        for k, t in zip(came, ticks.tolist(), strict=True)
    ]
    log = read_log(write_bag(tmp_path / "r", posts, kind), disorder=disorder)
    assert log.setpoint_cp.position[:, 0].tolist() == list(range(60))
    late = sum(k < max(came[:n], default=0) for n, k in enumerate(came))
    assert log.remarks == (
        f"{late} messages of /p/setpoint_cp were received out of order; they are sorted by their stamps.",
    )


@pytest.mark.parametrize("back", [1.4, 2.0, 9.7])
def test_a_clock_that_was_set_back_is_refused_or_costs_what_is_said(tmp_path: Path, back: float):
    """Sorted, samples of two stretches would alternate."""
    ticks = START + STEP * np.arange(60)
    stamps = ticks - np.where(np.arange(60) < 30, 0, int(back * STEP))
    posts = counted("/p/setpoint_cp", stamps, ticks)
    bag = write_bag(tmp_path / "r", posts, "bag")
    with pytest.raises(LogError, match="/p/setpoint_cp run backwards, the first at sample 31"):
        read_log(bag)
    left = read_log(bag, disorder="drop")
    assert f"sample 31; {60 - len(left)} of 60 samples were left out." in left.remarks[0]


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_a_recording_cut_off_anywhere_is_refused(tmp_path: Path, kind: str):
    whole = write_bag(tmp_path / "r", robot(), kind).read_bytes()
    cut = tmp_path / f"cut.{kind}"
    for size in np.linspace(1, len(whole) - 1, 6).astype(int):
        write(cut, whole[:size])
        with pytest.raises(LogError) as caught:
            read_log(cut)
        assert str(caught.value).startswith(str(cut))


@pytest.mark.parametrize(("kind", "tool"), [("bag", "rosbag reindex"), ("mcap", "mcap recover")])
def test_a_recording_without_its_end_says_how_to_repair_it(tmp_path: Path, kind: str, tool: str):
    whole = write_bag(tmp_path / "r", robot(), kind)
    write(whole, whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    for path in (whole, tmp_path / "r") if kind == "mcap" else (whole,):
        with pytest.raises(LogError, match=rf"may be cut off or still being written.*{tool}"):
            read_log(path)


def test_a_missing_library_names_the_extra_that_brings_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    bag = write_bag(tmp_path / "r", robot(), "bag")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError, match=r"rosbags, which is not installed.*gpcorrect\[ros\]"):
        rosbag.read(bag, ReadSettings())


def test_what_was_seen_of_another_arm_is_not_taken_for_this_one(tmp_path: Path):
    """Each arm's own tracker is chosen with the arm; that of the other arm alone is none."""
    both = robot("/PSM1") + robot("/PSM2")
    seen = write_bag(tmp_path / "other", both + poses("/PSM2/tracker_cp"), "bag")
    assert read_log(seen, namespace="/PSM2").tracker_cp is not None
    assert read_log(seen, namespace="/PSM1").tracker_cp is None
    two = both + poses("/PSM1/tracker_cp") + poses("/PSM2/tracker_cp", late=1)
    log = read_log(write_bag(tmp_path / "two", two, "bag"), namespace="/PSM1")
    assert log.remarks == ("/PSM1/tracker_cp was taken for the tracker.",)
