"""A simulated robot keeps CRTK's rules whatever it is told."""

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of, model_from_dict, preset
from gpcorrect.sim.live_robot import LiveRobot

SPEED = np.deg2rad([5.0, 5.0, 0.0, 15.0, 15.0, 15.0]) + np.array([0, 0, 0.02, 0, 0, 0])


def robot(*, ready: bool = True) -> LiveRobot:
    """Return the debridement arm."""
    arm = LiveRobot(machine_of(preset("raven2_debridement")), np.random.default_rng(0))
    if ready:
        arm.operate("enable")
        arm.operate("home")
    return arm


@pytest.mark.parametrize("words", [(), ("enable",), ("enable", "home", "disable"), ("enable", "home", "pause")])
def test_a_robot_that_is_not_ready_does_not_move(words):
    """Only an enabled and homed robot takes commands; any other one says why and stays."""
    arm = robot(ready=False)
    for word in words:
        arm.operate(word)
    before = arm.setpoint
    for command in (arm.servo_jp, arm.move_jp):
        with pytest.raises(DataError, match="does not move"):
            command(before + 0.01)
    arm.advance(0.2)
    np.testing.assert_array_equal(arm.setpoint, before)


def test_states_follow_crtk():
    """A disabled robot cannot be paused or homed, a paused one resumes, and homing is kept until it is undone."""
    arm = robot(ready=False)
    for word in ("pause", "resume", "home", "dance"):
        with pytest.raises(DataError):
            arm.operate(word)
    for word, state, homed in (
        ("enable", "ENABLED", False),
        ("home", "ENABLED", True),
        ("pause", "PAUSED", True),
        ("resume", "ENABLED", True),
        ("unhome", "ENABLED", False),
        ("disable", "DISABLED", False),
    ):
        arm.operate(word)
        assert (arm.state, arm.is_homed) == (state, homed)


def test_a_move_ends_at_its_goal_within_the_speed_limits():
    """A joint move arrives exactly, and no joint is ever commanded faster than its limit."""
    arm = robot()
    goal = arm.setpoint + np.array([0.1, -0.05, 0.02, 0.3, -0.2, 0.1])
    arm.move_jp(goal)
    assert arm.is_busy
    path = [arm.setpoint]
    for _ in range(1000):
        if not arm.is_busy:
            break
        arm.advance(0.01)
        path.append(arm.setpoint)
    np.testing.assert_allclose(arm.setpoint, goal, atol=1e-12)
    speeds = np.abs(np.diff(path, axis=0)).max(axis=0) / 0.01
    assert (speeds <= SPEED * (1 + 1e-6)).all()
    assert (speeds / SPEED).max() > 0.95


def test_a_straight_move_goes_straight():
    """The commanded tool keeps to the line between start and goal, and arrives."""
    arm = robot()
    start = arm.T_setpoint
    assert start is not None
    goal = se3.pose(start[:3, :3], start[:3, 3] + np.array([0.01, 0.015, -0.01]))
    arm.move_cp(goal)
    places = []
    while arm.is_busy:
        arm.advance(0.02)
        T = arm.T_setpoint
        assert T is not None
        places.append(T[:3, 3])
    way = goal[:3, 3] - start[:3, 3]
    along = (np.array(places) - start[:3, 3]) @ way / (way @ way)
    off = np.array(places) - start[:3, 3] - along[:, None] * way
    assert np.linalg.norm(off, axis=1).max() < 1e-5
    np.testing.assert_allclose(places[-1], goal[:3, 3], atol=1e-6)


def test_servo_commands_are_followed_and_jumps_are_not():
    """A stream of small steps is followed; one that jumps is refused, and the arm goes on from where it was."""
    arm = robot()
    begin = arm.setpoint
    for k in range(1, 31):
        arm.servo_jp(begin + k * 0.001)
        arm.advance(0.02)
    assert np.abs(arm.setpoint - (begin + 0.03)).max() < 0.002
    before = arm.setpoint
    with pytest.raises(DataError, match="would have to jump"):
        arm.servo_jp(before + np.array([0.2, 0, 0, 0, 0, 0]))
    arm.advance(0.02)
    assert np.abs(arm.setpoint - before).max() < 0.01


def test_limits_are_kept():
    """A command beyond a joint's limits is refused by number."""
    arm = robot()
    assert arm.limits is not None
    beyond = arm.setpoint
    beyond = np.where(np.arange(6) == 2, arm.limits[2, 1] + 0.01, beyond)
    with pytest.raises(DataError, match="joint 3 would go beyond"):
        arm.move_jp(beyond)
    with pytest.raises(DataError, match="6 joints"):
        arm.move_jp(np.zeros(5))


def test_a_pose_command_is_its_joints():
    """Sending the pose of reachable joints brings the robot to these joints."""
    arm = robot()
    q = arm.setpoint + np.array([0.01, 0.01, 0.001, 0.02, 0.02, -0.02])
    T = arm.poses_of(q[None])
    assert T is not None
    arm.servo_cp(T[0])
    for _ in range(50):
        arm.advance(0.02)
    np.testing.assert_allclose(arm.setpoint, q, atol=1e-9)


def test_bare_joints_take_joints_only():
    """A machine without kinematics moves its joints and refuses poses."""
    arm = LiveRobot(machine_of(model_from_dict({"arm": "joints", "joints": [1, 2]})), np.random.default_rng(0))
    arm.operate("enable")
    arm.operate("home")
    arm.move_jp(np.array([0.1, -0.1]))
    arm.advance(2.0)
    np.testing.assert_allclose(arm.setpoint, [0.1, -0.1], atol=1e-12)
    with pytest.raises(DataError):
        arm.move_cp(np.eye(4))
    assert arm.read().tracker is None
