from dataclasses import replace

import numpy as np
import pytest
from sim_machines import moves, raven

from gpcorrect.arms import Chain, arm_named
from gpcorrect.sim import dynamics, run
from gpcorrect.sim.body import Body, Links
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import CableStretch, CoulombFriction, Payload
from gpcorrect.sim.plant import Command, follow_command

ARMS = ["raven2_left", "raven2_right", "dvrk_psm"]


def body_of(name, payload=0.3):
    """All six joints of an arm, every link with mass and inertia."""
    arm, rng = arm_named(name), np.random.default_rng(1)
    links = Links(
        rng.uniform(0.1, 1.0, 6), rng.uniform(-0.1, 0.1, (6, 3)), rng.uniform(1e-4, 1e-2, (6, 3)), np.array([payload])
    )
    return Body(tuple(range(1, 7)), arm.joint_types, arm.chain, np.zeros(0), links, np.array([1.0, -2.0, -9.0]))


def states(count=20, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform([0, 0.8, 0.25, -1, -1, -1], [1.5, 2.3, 0.5, 1, 1, 1], (count, 6))
    return q[:, None], rng.standard_normal((count, 1, 6)), rng.standard_normal((count, 1, 6))


@pytest.mark.parametrize("name", ARMS)
def test_load_is_the_euler_lagrange_derivative(name):
    """Inertial load equals d/dt dK/dq' - dK/dq, with the kinetic energy taken from differentiated frames."""
    body = body_of(name, payload=0.0)
    q, velocity, acceleration = (a[0, 0] for a in states(1, seed=3))
    h = 1e-4

    def kinetic(q, velocity):
        frames = [body.chain.frames(q + s * velocity) for s in (-h, h)]
        energy = 0.0
        for i, (mass, com, moments) in enumerate(
            zip(body.links.mass, body.links.com, body.links.inertia_diagonal, strict=True)
        ):
            before, after = (f[i] for f in frames)
            v = ((after[:3, :3] - before[:3, :3]) @ com + after[:3, 3] - before[:3, 3]) / (2 * h)
            spin = body.chain.frames(q)[i, :3, :3].T @ (after[:3, :3] - before[:3, :3]) / (2 * h)
            omega = np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]]) / 2
            energy += 0.5 * mass * v @ v + 0.5 * moments @ omega**2
        return energy

    def momentum(q, velocity):
        return np.array([(kinetic(q, velocity + e) - kinetic(q, velocity - e)) / 2 for e in np.eye(6)])

    d = 1e-3
    rate = (
        momentum(q + d * velocity, velocity + d * acceleration)
        - momentum(q - d * velocity, velocity - d * acceleration)
    ) / (2 * d)
    slope = np.array([(kinetic(q + d * e, velocity) - kinetic(q - d * e, velocity)) / (2 * d) for e in np.eye(6)])
    load = posture_at(body, q[None, None]).loads(velocity[None, None], acceleration[None, None])[1][0, 0]
    np.testing.assert_allclose(load, rate - slope, atol=2e-4 * np.abs(load).max())


@pytest.mark.parametrize("name", ARMS)
def test_gravity_load_is_the_slope_of_potential_energy(name):
    """The load that holds an arm is the gradient of its potential energy."""
    body = body_of(name)
    q, h = states(1, seed=4)[0][0, 0], 1e-6

    def energy(q):
        T, tip = body.chain.frames(q), body.chain.forward(q)[:3, 3]
        centres = (T[:, :3, :3] @ body.links.com[..., None])[..., 0] + T[:, :3, 3]
        return -(body.links.mass @ centres + 0.3 * tip) @ body.gravity

    slope = [(energy(q + h * e) - energy(q - h * e)) / (2 * h) for e in np.eye(6)]
    np.testing.assert_allclose(posture_at(body, q[None, None]).gravity_load()[0, 0], slope, atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_inertia_diagonal_is_the_load_of_unit_acceleration(name):
    """Accelerating one joint alone from rest takes its diagonal inertia."""
    posture = posture_at(body_of(name), states(5)[0])
    for j in range(6):
        unit = np.zeros((5, 1, 6))
        unit[..., j] = 1.0
        load = posture.loads(np.zeros((5, 1, 6)), unit)[1]
        np.testing.assert_allclose(load[..., j], posture.inertia_diagonal()[..., j], atol=1e-12)


def test_held_joints_can_be_folded_into_the_tool():
    """A compact body carries the same loads and reaches the same poses."""
    body = replace(raven().body, held=np.array([0.3, -0.2, 0.5]))
    q = states()[0][..., :3]
    small = body.compact()
    assert small.chain.dof == 3
    np.testing.assert_allclose(small.forward(q), body.forward(q), atol=1e-12)
    loaded = replace(body, links=replace(body.links, payload=np.array([0.5])))
    np.testing.assert_allclose(
        posture_at(loaded.compact(), q).gravity_load(), posture_at(loaded, q).gravity_load(), atol=1e-12
    )


def test_weightless_arms_have_no_posture():
    """Nothing to carry, nothing to compute."""
    body = replace(raven().body, links=Links.none())
    assert posture_at(body, np.zeros((2, 1, 3))) is None
    assert isinstance(body.chain, Chain)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 50])
@pytest.mark.parametrize("length", [0, 1, 5, 24])
def test_parts_make_the_whole_range(monkeypatch, count, length):
    """Every item is worked on once, however many threads there are."""
    monkeypatch.setattr(dynamics, "thread_count", lambda: count)
    visits = np.zeros(length)

    def visit(first, last):
        visits[first:last] += 1

    dynamics.in_parts(length, 10 * dynamics.WORTH_A_THREAD, visit)
    np.testing.assert_array_equal(visits, 1)


def test_motion_is_the_same_on_any_number_of_threads(monkeypatch):
    """Runs do not depend on each other: the parts they are shared out in change no bit."""
    plan, machine = moves(runs=5, seconds=2.0), raven(CoulombFriction(1, torque=0.4))
    monkeypatch.setattr(dynamics, "WORTH_A_THREAD", 1)
    paths = []
    for count in (1, 3):
        monkeypatch.setattr(dynamics, "thread_count", lambda count=count: count)
        paths.append(run(machine, plan).q)
    np.testing.assert_array_equal(*paths)


@pytest.mark.parametrize(("stated", "count"), [("1", 1), ("", 2), ("999", 2), ("two", 2)])
def test_stated_threads_are_not_exceeded(monkeypatch, stated, count):
    """OMP_NUM_THREADS lowers the number of threads, and never raises it above numba's."""
    monkeypatch.setattr(dynamics.numba.config, "NUMBA_NUM_THREADS", 2)
    monkeypatch.setenv("OMP_NUM_THREADS", stated)
    assert dynamics.thread_count() == count


@pytest.mark.parametrize(
    "effects",
    [(), (CoulombFriction(2, torque=0.3),), (CableStretch(2, 80.0),), (Payload("all", 0.3),)],
    ids=["none", "friction", "stretch", "payload"],
)
def test_a_command_serves_any_effects(effects):
    """A command made without effects gives the motion that one made for them would."""
    plan = moves(runs=2, seconds=3.0)
    shared = Command.of(raven(), plan)
    np.testing.assert_array_equal(follow_command(raven(*effects), shared).q, run(raven(*effects), plan).q)
