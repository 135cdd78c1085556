"""The machines: RAVEN-II against its own software, the PSM against real recordings, and the masses of their links."""

import numpy as np
import pytest
from support import real_data

from gpcorrect import se3
from gpcorrect.arms import DA_VINCI_TOOL, RAVEN_TOOL, Link, Transmission, arm_named, dvrk_psm, raven2
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body, Links
from gpcorrect.sim.dynamics import posture_at

DEG = np.pi / 180


def random_joints(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], size=(n, arm.dof))


def software_transform(alpha, a, theta, d):
    """Return the link transform entry by entry, as the robot's control software writes it."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -sa * d], [st * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]])


@pytest.mark.parametrize("side", ["left", "right"])
def test_raven2_forward_is_that_of_its_software(side):
    """Joint offsets and table of the public control software, multiplied out by hand, give the same pose."""
    left = side == "left"
    alphas = [0 if left else np.pi, 75 * DEG, np.pi - 52 * DEG if left else 52 * DEG, 0, np.pi / 2, np.pi / 2]
    offsets = np.array([205, 180, 0, 0, -90, 0] if left else [25, 0, 0, 0, -90, 0]) * DEG
    arm = raven2(side)
    for q in random_joints(arm, 20):
        theta, d = q + offsets, np.array([0, 0, q[2], -0.47, 0, 0])
        theta[2] = np.pi / 2 if left else -np.pi / 2
        rows = zip(alphas, [0, 0, 0, 0, 0, 0.013], theta, d, strict=True)
        expected = np.linalg.multi_dot([software_transform(*row) for row in rows])
        np.testing.assert_allclose(arm.forward(q), expected, atol=1e-14)


def test_raven2_arms_mirror_each_other():
    """The right arm is the left one seen in the plane y = 0, with pitch kept, roll and yaw reversed."""
    left, right = raven2("left"), raven2("right")
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    q = random_joints(left, 50)
    mirrored = mirror @ left.forward(q * [1, 1, 1, -1, 1, -1]) @ mirror
    np.testing.assert_allclose(right.forward(q), mirrored, atol=1e-14)


def test_raven2_wrist_is_in_the_remote_centre_at_its_shaft_offset():
    """The wrist's distance from the base origin is |insertion - 0.47 m|, whatever the other joints."""
    arm = raven2("right")
    q = random_joints(arm, 100)
    np.testing.assert_allclose(np.linalg.norm(arm.wrist(q), axis=1), np.abs(q[:, 2] - 0.47), atol=1e-15)


def test_raven2_instruments_and_tools_move_the_tip():
    """The tip lies the instrument's wrist length from the wrist; a tool transform multiplies on."""
    q = random_joints(raven2("left"), 20)
    for instrument, length in ((RAVEN_TOOL, 0.013), (DA_VINCI_TOOL, 0.009)):
        arm = raven2("left", instrument)
        reach = np.linalg.norm(arm.forward(q)[:, :3, 3] - arm.wrist(q), axis=1)
        np.testing.assert_allclose(reach, length, atol=1e-15)
    tool = se3.exp(np.array([0.0, 0.0, 0.01, 0.1, 0.2, 0.3]))
    np.testing.assert_allclose(raven2("left", tool=tool).forward(q), raven2("left").forward(q) @ tool, atol=1e-15)


def test_raven2_numbers_are_si():
    """Limits, home and speeds are in rad and m."""
    arm = raven2("left")
    np.testing.assert_allclose(arm.limits[:3], [[0, np.pi / 2], [np.pi / 4, 3 * np.pi / 4], [0.23, 0.56]])
    np.testing.assert_allclose(arm.home, [np.pi / 6, np.pi / 2, 0.4, 0, 0, 0])
    np.testing.assert_allclose(arm.velocity_limits[:3], [5 * DEG, 5 * DEG, 0.02])
    assert arm.chain.within_limits(arm.home)


def test_raven2_transmission_has_the_published_ratios_and_coupling():
    """Joints follow motors by the published equations: th1 = m1/tr1, th2 = m2/tr2 - 0.145 th1, and so on."""
    drive = raven2("left").transmission
    np.testing.assert_allclose(drive.ratios[:3], [136, 121.5, 2158.6], rtol=2e-3)
    motor = np.random.default_rng(0).normal(scale=50, size=(20, 6))
    th1, th2, d3 = np.linalg.solve(drive.matrix, motor.T)[:3]
    tr1, tr2, tr3 = drive.ratios[:3]
    np.testing.assert_allclose(th1, motor[:, 0] / tr1, rtol=1e-12)
    np.testing.assert_allclose(th2, motor[:, 1] / tr2 - 0.14545 * th1, atol=1e-12)
    np.testing.assert_allclose(d3, motor[:, 2] / tr3 - 0.0077973826 * th1 - 0.008077387 * th2, atol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("instrument", [RAVEN_TOOL, DA_VINCI_TOOL])
def test_raven2_tool_motors_follow_the_jaw_equations(side, instrument):
    """Roll and pitch lose the insertion motor's drag; yaw is half the difference of the two coupled jaws."""
    drive = raven2(side, instrument).transmission
    motor = np.random.default_rng(1).normal(scale=20, size=6)
    jaw_sum = 3.0  # jaw motors m1 and m2 with m2 - m1 twice the yaw motor; their sum opens the grip only
    jaws = jaw_sum / 2 + np.array([-1, 1]) * motor[5]
    sign = instrument.insertion_sign * (1 if side == "left" else -1)
    first = -sign if instrument.opposed_jaws else sign
    drag = motor[2] / ((49 / 4) / (26 / 7) * 5.005 / 5.675)
    ratio_roll, ratio_pitch, ratio_jaw = drive.ratios[3:]
    roll, pitch = (motor[3] - sign * drag) / ratio_roll, (motor[4] - sign * drag) / ratio_pitch
    jaw_1 = (jaws[0] - first * drag) / ratio_jaw - instrument.jaw_coupling * pitch
    jaw_2 = (jaws[1] - sign * drag) / ratio_jaw + instrument.jaw_coupling * pitch
    expected = [roll, pitch, (jaw_2 - jaw_1) / 2]
    np.testing.assert_allclose(np.linalg.solve(drive.matrix, motor)[3:], expected, rtol=1e-12)


def test_transmission_keeps_power():
    """Lossless cables keep power: tau_m . m' = tau_q . q'."""
    drive, rng = raven2("right").transmission, np.random.default_rng(2)
    speed, joint_torque = rng.normal(size=(2, 5, 6))
    power_motor = (drive.motor_torque(joint_torque) * drive.motor_from_joint(speed)).sum(axis=1)
    np.testing.assert_allclose(power_motor, (joint_torque * speed).sum(axis=1), rtol=1e-12)


def test_transmissions_that_cannot_be_inverted_are_refused():
    """A row of zeros and a matrix that is not square raise."""
    with pytest.raises(DataError, match="singular"):
        Transmission(np.diag([1.0, 0.0]))
    with pytest.raises(DataError, match="square"):
        Transmission(np.ones((2, 3)))


@pytest.fixture(scope="module")
def recording():
    return np.genfromtxt(real_data("dvrk_random.csv"), delimiter=",", names=True)


@pytest.mark.parametrize(("joints", "pose"), [("setpoint_jp", "setpoint_cp"), ("external_jp", "tracker_cp")])
def test_psm_forward_gives_the_recorded_wrist_and_orientation(recording, joints, pose):
    """Recorded wrist points follow from joints 1 to 3, tip orientations from all six, to 1e-12."""
    arm = dvrk_psm()
    q = np.stack([recording[f"{joints}_{i}"] for i in range(1, 7)], axis=1)
    wrist = np.stack([recording[f"{pose}_{axis}"] for axis in "xyz"], axis=1)
    orientation = np.stack([recording[f"{pose}_q{axis}"] for axis in "wxyz"], axis=1)
    np.testing.assert_allclose(arm.wrist(q), wrist, atol=1e-12)
    np.testing.assert_allclose(arm.forward(q)[:, :3, :3], se3.matrix_from_quaternion(orientation), atol=1e-12)
    q[:, 3:] = 0.0
    np.testing.assert_allclose(arm.wrist(q), wrist, atol=1e-12)


def test_psm_inverse_gives_the_recorded_joints(recording):
    """Following the recorded tip poses in closed form gives the recorded joints back."""
    arm = dvrk_psm()
    q = np.stack([recording[f"external_jp_{i}"] for i in range(1, 7)], axis=1)
    np.testing.assert_allclose(arm.follow(arm.forward(q), start=q[0]), q, atol=1e-8)


def test_psm_tip_lies_beyond_the_wrist_by_its_two_links():
    """At straight wrist the tip is 9.1 + 10.2 mm beyond the wrist point, down the shaft."""
    arm = dvrk_psm()
    q = random_joints(arm, 20)
    q[:, 4:] = 0.0
    ahead = arm.forward(q)[:, :3, 3] - arm.wrist(q)
    down = arm.wrist(q) / np.linalg.norm(arm.wrist(q), axis=1, keepdims=True)
    deep = q[:, 2] > 0.02  # the wrist is below the remote centre
    np.testing.assert_allclose(ahead[deep], 0.0193 * down[deep], atol=1e-12)


def test_names_build_their_arms_and_others_are_listed():
    """Every known name gives the arm of that name; an unknown one is told the known ones."""
    for name in ("raven2_left", "raven2_right", "dvrk_psm"):
        assert arm_named(name).name == name
    with pytest.raises(DataError, match="dvrk_psm, raven2_left, raven2_right"):
        arm_named("raven3")
    with pytest.raises(DataError, match="'left' or 'right'"):
        raven2("middle")


@pytest.mark.parametrize("name", ["raven2_left", "raven2_right"])
def test_loads_agree_with_the_robot_own_compensation(name):
    """Its software sums moments com x m g in link frames 1 to 3 and projects on -z; joints 4 to 6 carry nothing."""
    arm = arm_named(name)
    count = len(arm.links)
    mass, com = np.array([link.mass for link in arm.links]), np.array([link.com for link in arm.links])
    links = Links(mass, com, np.zeros((count, 3)), np.zeros(1))
    body = Body(tuple(range(1, 7)), arm.joint_types, arm.chain, np.zeros(0), links, arm.gravity)
    for q in np.random.default_rng(0).uniform(arm.limits[:, 0], arm.limits[:, 1], size=(10, arm.dof)):
        frames = arm.chain.frames(q)[:3]
        holding = []
        for i, T_base_link in enumerate(frames):
            g = T_base_link[:3, :3].T @ arm.gravity
            centres = [(se3.invert(T_base_link) @ frames[k] @ [*arm.links[k].com, 1.0])[:3] for k in range(i, 3)]
            masses = [arm.links[k].mass for k in range(i, 3)]
            moment = sum(np.cross(c, m * g) for c, m in zip(centres, masses, strict=True))
            holding.append(-(sum(masses) * g if i == 2 else moment)[2])
        np.testing.assert_allclose(
            posture_at(body, q[None, None]).gravity_load()[0, 0], [*holding, 0, 0, 0], atol=1e-12
        )


def test_home_position_hangs_below_the_remote_centre():
    """At home both RAVEN-II tips and the PSM's lie on the falling side of the base origin."""
    for name in ("raven2_left", "raven2_right", "dvrk_psm"):
        arm = arm_named(name)
        assert arm.forward(arm.home)[:3, 3] @ arm.gravity > 0.5


def test_bad_masses_are_refused():
    """Negative mass, a centre that is no point."""
    with pytest.raises(DataError, match="mass"):
        Link(-1.0, np.zeros(3))
    with pytest.raises(DataError, match="centre"):
        Link(1.0, np.array([0.0, np.nan, 0.0]))
