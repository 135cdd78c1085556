"""Laws of gravity on arms: torques are the potential energy's slope."""

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint, Link, arm_named, gravity_torque
from gpcorrect.errors import DataError

ARMS = ["raven2_left", "raven2_right", "dvrk_psm"]
TILTED = np.array([-7.0, 3.0, 5.0])


def potential_energy(arm, q, payload):
    """Minus the sum of m g . c over links and payload, by the poses of the links."""
    T, tip = arm.chain.frames(q), arm.chain.forward(q)[..., :3, 3]
    points = [(link.mass, T[..., k, :3, :3] @ link.com + T[..., k, :3, 3]) for k, link in enumerate(arm.links)]
    return -sum(mass * (point @ TILTED) for mass, point in [*points, (payload, tip)])


def random_joints(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], size=(n, arm.dof))


@pytest.mark.parametrize("name", ARMS)
def test_torque_is_minus_the_slope_of_the_potential_energy(name):
    """The torque is -dU/dq by central differences, for links and a payload under tilted gravity."""
    arm, h = arm_named(name), 1e-5
    for q in random_joints(arm, 20):
        ahead, behind = (potential_energy(arm, q + s * np.eye(6), 0.5) for s in (h, -h))
        torque = arm.gravity_torque(q, TILTED, payload=0.5)
        np.testing.assert_allclose(torque, -(ahead - behind) / (2 * h), atol=1e-8)


def test_pendulum_has_its_textbook_torque():
    """A mass m at length l on one revolute joint feels -m g l cos(q) against rising."""
    chain = Chain((Joint("R", 0.0, 0.4, 0.0, 0.0, -np.pi, np.pi),), "standard")
    q = np.linspace(-3, 3, 11)[:, None]
    torque = gravity_torque(chain, [], q, [0.0, -9.81, 0.0], payload=2.0)
    np.testing.assert_allclose(torque, -2.0 * 9.81 * 0.4 * np.cos(q), atol=1e-13)


def test_link_mass_acts_at_its_centre_in_its_own_frame():
    """A link whose centre is the tip weighs like a payload of its mass."""
    chain = arm_named("dvrk_psm").chain
    q = random_joints(arm_named("dvrk_psm"), 10)
    massless = [Link(0.0, np.zeros(3))] * 5
    as_link = gravity_torque(chain, [*massless, Link(0.3, chain.tool[:3, 3])], q, TILTED)
    np.testing.assert_allclose(as_link, gravity_torque(chain, [], q, TILTED, payload=0.3), atol=1e-14)


def test_tool_joints_feel_only_the_payload():
    """The published RAVEN-II masses end at the carriage: joints 4 to 6 are free without a payload."""
    arm = arm_named("raven2_right")
    q = random_joints(arm, 10)
    np.testing.assert_array_equal(arm.gravity_torque(q)[:, 3:], 0.0)
    assert np.abs(arm.gravity_torque(q, payload=0.5)[:, 4]).min() > 0


@pytest.mark.parametrize("name", ["raven2_left", "raven2_right"])
def test_torque_agrees_with_the_robot_own_compensation(name):
    """Its software sums moments com x m g in link frames 1 to 3 and projects on -z: the opposite of ours."""
    arm = arm_named(name)
    for q in random_joints(arm, 10):
        frames = arm.chain.frames(q)[:3]
        holding = []
        for i, T_base_link in enumerate(frames):
            g = T_base_link[:3, :3].T @ arm.gravity
            centres = [(se3.invert(T_base_link) @ frames[k] @ [*arm.links[k].com, 1.0])[:3] for k in range(i, 3)]
            masses = [arm.links[k].mass for k in range(i, 3)]
            moment = sum(np.cross(c, m * g) for c, m in zip(centres, masses, strict=True))
            holding.append(-(sum(masses) * g if i == 2 else moment)[2])
        np.testing.assert_allclose(arm.gravity_torque(q)[:3], -np.array(holding), atol=1e-12)


def test_home_position_hangs_below_the_remote_centre():
    """At home both RAVEN-II tips and the PSM's lie on the falling side of the base origin."""
    for name in ARMS:
        arm = arm_named(name)
        assert arm.forward(arm.home)[:3, 3] @ arm.gravity > 0.5


def test_payload_may_differ_by_sample_and_stacks_equal_loops():
    """A payload (n,) acts row by row."""
    arm = arm_named("raven2_left")
    q, payload = random_joints(arm, 6), np.linspace(0, 0.5, 6)
    stacked = arm.gravity_torque(q, payload=payload)
    single = [arm.gravity_torque(row, payload=mass) for row, mass in zip(q, payload, strict=True)]
    np.testing.assert_allclose(stacked, single, atol=1e-14)
    np.testing.assert_allclose(
        arm.gravity_torque(q.reshape(2, 3, 6), payload=payload.reshape(2, 3)).reshape(6, 6), single
    )


def test_bad_masses_and_gravity_are_refused():
    """Negative mass, a centre that is no point, gravity of another shape, more links than joints."""
    arm = arm_named("raven2_left")
    with pytest.raises(DataError, match="mass"):
        Link(-1.0, np.zeros(3))
    with pytest.raises(DataError, match="centre"):
        Link(1.0, np.array([0.0, np.nan, 0.0]))
    with pytest.raises(DataError, match="gravity"):
        arm.gravity_torque(arm.home, gravity=[0.0, 9.81])
    with pytest.raises(DataError, match="6 links"):
        gravity_torque(arm.chain, arm.links * 3, arm.home, TILTED)
