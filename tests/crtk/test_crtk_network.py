import json
import threading
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import zenoh
from crtk_support import PATIENT, SHIFT, ShiftCorrector, free_endpoint, living_arm, model, wait_for
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import read_log
from gpcorrect_service.crtk import Bus, BusSettings, JointState, OperatingState, Pose
from gpcorrect_service.crtk.messages import from_cdr, to_cdr
from gpcorrect_service.crtk.prefilter import FilterServer, Prefilter, PrefilterSettings
from gpcorrect_service.crtk.recorder import Recorder, write_mcap
from gpcorrect_service.crtk.robot import Robot, RobotError
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.ros import rmw_key, ros_types
from gpcorrect_service.protocol.settings import RosDistro


def test_a_robot_is_driven_and_recorded(tmp_path):
    """A path that is streamed is what the log holds as setpoints, a trajectory each, with true joints beside."""
    with living_arm() as (settings, _), Robot(settings) as robot:
        recorder = Recorder(robot.bus)
        robot.make_ready()
        begin = robot.setpoint
        times = np.linspace(0.0, 1.0, 31)
        for number, joint in ((0, 0), (1, 2)):
            path = np.repeat(begin[None], len(times), axis=0)
            path[:, joint] += 0.004 * np.clip(2.0 * np.sin(np.pi * times), 0.0, 1.0)  # late samples are no jump
            robot.follow(times, path, number)
        log = recorder.recording().log()
        write_mcap(recorder.recording(), tmp_path / "bag")
        with pytest.raises(LogError, match="already"):
            write_mcap(recorder.recording(), tmp_path / "bag")
    assert set(log.signals) >= {"setpoint_jp", "measured_jp", "external_jp", "tracker_cp", "setpoint_cp"}
    np.testing.assert_array_equal(log.trajectory_ids, [0, 1])
    reach = log.setpoint_jp - begin
    assert np.ptp(reach[log.trajectory == 0, 0]) == pytest.approx(0.004, rel=0.2)
    assert np.ptp(reach[log.trajectory == 1, 2]) == pytest.approx(0.004, rel=0.2)
    assert np.abs(reach[log.trajectory == 1, 0]).max() < 1e-6
    assert (np.diff(log.time) > 0).all()
    bag = read_log(tmp_path / "bag")
    assert {"setpoint_jp", "measured_jp", "external_jp", "tracker_cp"} <= set(bag.signals)
    seen = bag.setpoint_jp[np.isfinite(bag.setpoint_jp[:, 2]), 2]
    assert np.ptp(seen) == pytest.approx(0.004, rel=0.2)


def test_what_a_robot_refuses_it_explains():
    """A command that cannot be obeyed ends with the robot's own reason."""
    with living_arm() as (settings, _), Robot(settings) as robot:
        with pytest.raises(RobotError, match="does not move"):
            robot.move_jp(robot.setpoint + 0.01)
        robot.make_ready()
        with pytest.raises(RobotError, match="limits"):
            robot.move_jp(robot.setpoint + 5.0)


def test_a_state_that_is_not_reached_is_an_error():
    """A state command that the robot does not obey, or that there is not, ends with words."""
    with living_arm() as (settings, _), Robot(settings, patience=2.0) as robot:
        with pytest.raises(DataError, match="'foo'"):
            robot.operate("foo")
        with pytest.raises(RobotError, match="does not obey pause"):
            robot.operate("pause")
        assert robot.state.state == "DISABLED"


def test_no_robot_is_said_so():
    """A tool without a robot says who was asked for."""
    with pytest.raises(EndpointError, match="nobody answers"):
        Robot(BusSettings("tcp/127.0.0.1:1", patience=0.2))
    with living_arm() as (settings, _), pytest.raises(RobotError, match="gpcorrect/PSM9"):
        Robot(BusSettings(settings.endpoint, arm="PSM9"), patience=0.5)


def test_commands_without_a_stamp_are_refused():
    """The arm moves on no command whose stamp is 0."""
    with living_arm() as (settings, arm), Robot(settings) as robot:
        robot.make_ready()
        said: list[str] = []
        robot.bus.subscribe("error", lambda message: said.append(message.string))
        before = robot.setpoint
        robot.bus.publish("servo_jp", JointState(0.0, tuple((before + 0.01).tolist())))
        wait_for(lambda: bool(said))
        assert "stamp" in said[0]
        np.testing.assert_array_equal(arm.setpoint, before)


@pytest.mark.parametrize("quaternion", [(1e-200, 0, 0, 0), (1e300, 0, 0, 0), (0, 0, 0, 0), (2, 0, 0, 0)])
def test_a_pose_that_is_none_is_refused_and_the_arm_goes_on(quaternion):
    """One such command ended the arm's server."""
    with living_arm() as (settings, _), Robot(settings) as robot:
        robot.make_ready()
        said: list[str] = []
        robot.bus.subscribe("error", lambda message: said.append(message.string))
        robot.bus.publish("move_cp", Pose(robot.time, (0.0, 0.0, -0.1, *quaternion)))
        wait_for(lambda: bool(said))
        assert "norm" in said[0]
        robot.operate("disable")


@pytest.mark.parametrize("distro", get_args(RosDistro))
def test_ros_users_are_understood_both_ways(distro: RosDistro):
    """On rmw_zenoh's keys a CDR command moves the arm, and its state is CDR that rosbags reads, attachment beside."""
    with living_arm(ros_domain=5, ros_distro=distro) as (settings, arm), Robot(settings) as robot:
        robot.make_ready()
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([settings.endpoint]))
        samples: list[zenoh.Sample] = []
        key = rmw_key(5, "arm1/measured_js", "sensor_msgs/msg/JointState", distro)
        frames: list[zenoh.Sample] = []
        tf = rmw_key(5, "tf", "tf2_msgs/msg/TFMessage", distro)
        with (
            zenoh.open(config) as ros,
            ros.declare_subscriber(key, samples.append),
            ros.declare_subscriber(tf, frames.append),
        ):
            tokens = [str(reply.ok.key_expr) for reply in ros.liveliness().get("@ros2_lv/**") if reply.ok]
            goal = robot.setpoint + np.array([0.01, 0, 0, 0, 0, 0])
            command = to_cdr(JointState(robot.time, tuple(goal.tolist())))
            ros.put(rmw_key(5, "arm1/move_jp", "sensor_msgs/msg/JointState", distro), command)
            wait_for(lambda: bool(np.abs(arm.setpoint - goal).max() < 1e-9))
            wait_for(lambda: len(samples) > 3 and len(frames) > 0)
        (frame,) = ros_types().deserialize_cdr(frames[-1].payload.to_bytes(), "tf2_msgs/msg/TFMessage").transforms
        assert frame.child_frame_id == "arm1_tool"
        assert frame.header.frame_id
        moved = frame.transform.translation
        assert np.linalg.norm([moved.x, moved.y, moved.z] - arm.poses_of(arm.setpoint[None])[0, :3, 3]) < 0.02
        message = from_cdr(samples[-1].payload.to_bytes(), "sensor_msgs/msg/JointState")
        raw = ros_types().deserialize_cdr(samples[-1].payload.to_bytes(), "sensor_msgs/msg/JointState")
        assert isinstance(message, JointState)
        assert raw.name[0] == "joint_1"
        first, second = (sample.attachment.to_bytes() for sample in samples[:2])
        assert int.from_bytes(second[:8], "little") == int.from_bytes(first[:8], "little") + 1
        assert first[17:] == second[17:]
        assert any("/MP/" in t and "%arm1%measured_js" in t for t in tokens)
        assert any("/MS/" in t and "%arm1%servo_cp" in t for t in tokens)
        assert all(("TypeHashNotSupported" in t) == (distro == "humble") for t in tokens if "/NN/" not in t)


def test_who_speaks_both_ways_is_heard_once():
    """Arm and tools in one ROS domain send on native keys and on those of ROS: a move was made twice."""
    with living_arm(ros_domain=5) as (settings, arm), Robot(replace(settings, ros_domain=5)) as robot:
        stamps: list[float] = []
        robot.bus.subscribe("measured_js", lambda message: stamps.append(message.stamp))
        moves: list[object] = []
        with Bus(replace(settings, ros_domain=5)) as other:
            other.subscribe("move_jp", moves.append)
            robot.make_ready()
            goal = robot.setpoint + 0.001
            robot.move_jp(goal)
            wait_for(lambda: len(stamps) > 20)
        np.testing.assert_allclose(arm.setpoint, goal, atol=1e-6)
    assert len(moves) == 1
    assert len(set(stamps)) == len(stamps)


def test_a_ros_node_that_comes_late_hears_the_state():
    """The last operating_state reaches a subscriber with history that came after it was sent, and a plain one never."""
    with Bus(BusSettings(free_endpoint(), role="hub", ros_domain=5)) as bus:
        bus.publish("operating_state", OperatingState(1.0, "DISABLED", False, False))
        bus.publish("operating_state", OperatingState(2.0, "ENABLED", True, False))
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([bus.settings.endpoint]))
        heard: list[zenoh.Sample] = []
        plain: list[zenoh.Sample] = []
        key = rmw_key(5, "arm1/operating_state", "crtk_msgs/msg/OperatingState", "jazzy")
        with (
            zenoh.open(config) as late,
            late.declare_subscriber(key, plain.append),
            declare_advanced_subscriber(
                late, key, heard.append, history=HistoryConfig(detect_late_publishers=True, max_samples=1)
            ),
        ):
            wait_for(lambda: bool(heard))
            tokens = [str(reply.ok.key_expr) for reply in late.liveliness().get("@ros2_lv/**") if reply.ok]
        assert plain == []
    state = from_cdr(heard[-1].payload.to_bytes(), "crtk_msgs/msg/OperatingState")
    assert (len(heard), state) == (1, OperatingState(2.0, "ENABLED", True, False))
    assert any("/MP/" in t and "%arm1%operating_state" in t and t.endswith("/:1:,1:,:,:,,") for t in tokens)


def test_an_arm_has_one_prefilter():
    """A second one is refused, for the robot would follow two models in turn; another arm has its own."""
    filtering = Prefilter(model(ShiftCorrector()))
    end, log = free_endpoint(), open_logger()
    with Bus(BusSettings(end, role="hub")), Bus(BusSettings(end, "arm2")) as other:
        with Bus(BusSettings(end)) as first:
            FilterServer(filtering, first, log)
            FilterServer(filtering, other, log)
            with Bus(BusSettings(end)) as second, pytest.raises(DataError, match="another prefilter"):
                FilterServer(filtering, second, log)
        with Bus(BusSettings(end)) as later:
            FilterServer(filtering, later, log)


def test_the_prefilter_stands_between_planner_and_robot():
    """A robot that listens to the pre-filter alone goes where the corrected command says, not where the planner did."""
    corrector = ShiftCorrector()
    settled = PrefilterSettings(time_scale=5.0, command_age=PATIENT, state_age=PATIENT)  # a busy machine holds all up
    with living_arm(corrected=True) as (settings, arm), Robot(settings) as robot, Bus(settings) as bus:
        stop = threading.Event()
        server = FilterServer(Prefilter(model(corrector), settled), bus, open_logger())
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            said, reports = [], []
            robot.bus.subscribe("error", lambda message: said.append(message.string))
            robot.bus.subscribe("corrected/report", reports.append)
            pose = robot.setpoint_pose
            assert pose is not None
            for _ in range(500):
                robot.servo_cp(pose)
                threading.Event().wait(0.02)
                if any("Enable and home" in text for text in said):
                    break
            assert any("Enable and home" in text for text in said)
            robot.make_ready()
            desired = pose + np.array([0.002, 0, 0, 0, 0, 0, 0])
            while not reports:
                robot.servo_cp(desired)
                threading.Event().wait(0.02)
            goal = desired[:3] + SHIFT
            robot.bus.publish("move_cp", Pose(robot.time, tuple(desired.tolist())))

            def arrived() -> bool:
                T = arm.T_setpoint
                return T is not None and bool(np.abs(T[:3, 3] - goal).max() < 1e-5)

            wait_for(arrived)
        finally:
            stop.set()
            thread.join(10)
        assert reports[0].model_id == "shift"


def test_a_tool_that_cannot_keep_up_slows_the_path_down():
    """On an arm that lives much faster than its tool streams, a path takes longer and is followed without a jump."""
    with living_arm(time_scale=100.0) as (settings, _), Robot(settings) as robot:
        robot.make_ready()
        begin, times = robot.setpoint, np.linspace(0.0, 4.0, 121)
        path = np.repeat(begin[None], len(times), axis=0)
        path[:, 0] += 0.05 * np.sin(np.pi * times / 2)
        recorder = Recorder(robot.bus, ("measured_js", "setpoint_js"))
        robot.follow(times, path)
        log = recorder.recording().log()
    assert np.ptp(log.setpoint_jp[:, 0]) == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(log.setpoint_jp[-1], path[-1], atol=0.01)
