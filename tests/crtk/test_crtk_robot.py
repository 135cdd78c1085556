"""What a tool commands, on a bus whose states the test makes."""

import threading
from pathlib import Path

import numpy as np
import pytest

from gpcorrect_service.crtk import BusSettings, JointState
from gpcorrect_service.crtk import robot as robot_module
from gpcorrect_service.crtk.messages import OperatingState
from gpcorrect_service.crtk.robot import Robot, RobotError

RATE_HZ = 30.0
SPEED = 0.08  # rad/s


class HeldUpBus:
    """An arm of one joint that obeys at once, whose states 30 to 90 of a path are old: the setpoint stands in them."""

    def __init__(self, settings, node):
        self.settings = settings
        self.inboxes = {}
        self.stamp, self.setpoint, self.commanded, self.states = 1.0, 0.0, 0.0, 0
        self.leads = []  # rad from the setpoint of the latest state to each command
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._publish_states)

    def subscribe(self, name, inbox, refused=None):
        self.inboxes[name] = inbox
        if name == "error":
            self.inboxes["operating_state"](OperatingState(1.0, "ENABLED", True, False))
            self.inboxes["setpoint_js"](JointState(1.0, (0.0,)))
            self.thread.start()

    def publish(self, name, message):
        if name == "move_jp" and message.position[0] > 1.0:  # begins, and stops where it was; shorter moves are lost
            self.inboxes["operating_state"](OperatingState(self.stamp, "ENABLED", True, True))
            self.inboxes["operating_state"](OperatingState(self.stamp, "ENABLED", True, False))
        if name == "servo_jp":
            self.commanded = message.position[0]
            self.leads.append(abs(self.commanded - self.setpoint))

    def _publish_states(self):
        while not self.stop.wait(0.001):
            self.states += bool(self.leads)
            if not 30 <= self.states < 90:
                self.setpoint = self.commanded
            self.stamp += 1.0 / RATE_HZ
            self.inboxes["setpoint_js"](JointState(self.stamp, (self.setpoint,)))

    def close(self):
        self.stop.set()
        self.thread.join()


def test_old_states_that_come_all_at_once_make_no_jump(monkeypatch):
    """Commands sent for states that piled up stay within 0.3 s of the path from the setpoint, and the path is ended."""
    monkeypatch.setattr(robot_module, "Bus", HeldUpBus)
    times = np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    with Robot(BusSettings("tcp/127.0.0.1:1")) as robot:
        robot.follow(times, SPEED * times[:, None])
        assert max(robot.bus.leads) < 0.3 * SPEED
        assert robot.bus.commanded == SPEED * times[-1]


@pytest.mark.parametrize("goal", [0.5, 2.0])
def test_a_move_that_is_lost_or_stops_elsewhere_is_not_waited_for(monkeypatch, goal):
    """A command that never came, and an arm that stops on the way, end in words after the tool's patience."""
    monkeypatch.setattr(robot_module, "Bus", HeldUpBus)
    with (
        Robot(BusSettings("tcp/127.0.0.1:1"), patience=0.2) as robot,
        pytest.raises(RobotError, match="does not go to"),
    ):
        robot.move_jp(np.array([goal]))


def test_a_robot_that_does_not_answer_is_looked_for_where_the_configuration_says(monkeypatch):
    """The message names the file that was given, and not the default address."""
    monkeypatch.setattr(robot_module, "Bus", HeldUpBus)
    with (
        Robot(BusSettings(role="client", config_file=Path("site/robot.json5")), patience=0.2) as robot,
        pytest.raises(RobotError, match=r"on site/robot\.json5 does not go to"),
    ):
        robot.move_jp(np.array([0.5]))


def test_joints_that_come_late_are_waited_for(monkeypatch):
    """What has not come yet is waited for; a robot that never reports joints is told, one without pose has none."""
    monkeypatch.setattr(robot_module, "Bus", HeldUpBus)
    with Robot(BusSettings("tcp/127.0.0.1:1"), patience=0.2) as robot:
        with pytest.raises(RobotError, match="does not report its joints"):
            _ = robot.measured
        assert robot.setpoint_pose is None
        late = threading.Timer(0.05, robot.bus.inboxes["measured_js"], (JointState(1.0, (0.3,)),))
        late.start()
        assert robot.measured == [0.3]
