"""Effects inside the servo loop: friction, saturation and stops."""

from dataclasses import replace

import numpy as np
import pytest
from sim_machines import RATE_HZ, constant_speed, drive, hold, motion, moves, raven, weightless

from gpcorrect.errors import DataError
from gpcorrect.sim import Segment, plan_of, run
from gpcorrect.sim.effects import (
    CableStretch,
    CapstanFriction,
    CoulombFriction,
    JointStop,
    Payload,
    PositionDependentFriction,
    PulleyEccentricity,
    StribeckFriction,
    TorqueSaturation,
    ViscousFriction,
)

KP = drive().kp


LAWS = (
    CoulombFriction(1, torque=0.4),
    ViscousFriction(1, damping=1.0),
    StribeckFriction(1, torque=0.3, static_torque=0.6, speed=0.05),
    CoulombFriction(1, torque=0.4, rest="elastic", bristle=100.0),
    CapstanFriction(1, wrap=0.4),
    PositionDependentFriction(1, torque=0.3, swing=-0.2, waves=12.0, phase=0.5),
)


@pytest.mark.parametrize("effect", LAWS, ids=lambda e: e.about.name)
def test_friction_behind_the_cable_is_carried_by_it(effect):
    """On the joint's side the same friction loads the cable, on the motor's side it does not."""
    plan = moves(runs=1, seconds=1.5)
    stretched = CableStretch(1, 120.0)
    before, behind = (run(raven(replace(effect, side=side), stretched), plan, passes=4) for side in ("motor", "joint"))
    np.testing.assert_allclose(before.torque[..., 0], behind.torque[..., 0], atol=0.05)
    extra = np.abs(behind.motion.load - before.motion.load)[..., 0]
    assert extra.max() > 0.05


UNIT = 2e-3 * KP  # N m and N
STEADY = {
    "coulomb": (lambda j, f: CoulombFriction(j, torque=f), lambda v: 1.0),
    "viscous": (lambda j, f: ViscousFriction(j, damping=10.0 * f), lambda v: 10.0 * v),
    "stribeck": (
        lambda j, f: StribeckFriction(j, torque=f, static_torque=2.5 * f, speed=0.1),
        lambda v: 1.0 + 1.5 * np.exp(-((v / 0.1) ** 2)),
    ),
}


@pytest.mark.parametrize("joint", [1, 2, 3])
@pytest.mark.parametrize(("friction", "law"), STEADY.values(), ids=STEADY)
def test_a_steady_joint_lags_by_its_friction_through_its_gain(friction, law, joint):
    """Whatever the speed, odd in the direction; the others are where they should be."""
    for speed in (0.05, -0.1, 0.2, -0.5):
        plan = constant_speed(np.full(3, speed))
        error = (plan.q - run(weightless(friction(joint, UNIT[joint - 1])), plan).q)[-1, 0]
        expected = np.where(np.arange(1, 4) == joint, np.sign(speed) * law(abs(speed)) * UNIT / KP, 0.0)
        np.testing.assert_allclose(error, expected, rtol=1e-5, atol=1e-8)


def test_stribeck_friction_with_one_limit_is_coulombs():
    """Where static and kinetic friction agree nothing is left of the speed."""
    plan = moves(runs=1, seconds=2.0)
    one = run(weightless(StribeckFriction(1, torque=0.4, static_torque=0.4, speed=0.1)), plan)
    two = run(weightless(CoulombFriction(1, torque=0.4)), plan)
    np.testing.assert_allclose(one.q, two.q, atol=1e-12)


def loop_width(effect, payload):
    """Width of the insertion's torque loop at mid-stroke, and the load there, slowly up and down."""
    n = round(3.0 * RATE_HZ)
    ramp = np.linspace(0.33, 0.39, n)
    q = np.tile([0.6, 1.5, 0.36], (2 * n + 1, 1))
    q[:, 2] = [*ramp, ramp[-1], *ramp[::-1]]
    plan = plan_of([Segment(q, np.zeros(len(q), dtype=np.int64), payload=payload)], RATE_HZ)
    outcome = run(raven(effect, inertia=0.0), plan, passes=4)
    up, down = outcome.torque[n // 2, 0, 2], outcome.torque[-n // 2, 0, 2]
    return up, down, outcome.motion.gravity_load[n // 2, 0, 2]


@pytest.mark.parametrize("payload", [0.1, 0.4, 1.0])
def test_capstan_friction_multiplies_the_load(payload):
    """One way the motor pays the load times exp(mu theta), the other way times exp(-mu theta)."""
    wrap = 0.25
    up, down, load = loop_width(CapstanFriction(3, wrap=wrap), payload)
    heavy, light = (up, down) if load > 0 else (down, up)
    assert heavy == pytest.approx(load * np.exp(wrap), rel=0.02)
    assert light == pytest.approx(load * np.exp(-wrap), rel=0.02)


def test_coulomb_friction_does_not_know_the_load():
    """Coulomb's loop is as wide under any load: what tells it from a capstan's."""
    widths = [np.subtract(*loop_width(CoulombFriction(3, torque=2.0), m)[:2]) for m in (0.1, 1.0)]
    assert widths[0] == pytest.approx(4.0, rel=0.05)
    assert widths[1] == pytest.approx(widths[0], rel=0.02)


def test_a_capstan_without_load_is_free():
    plan = moves(runs=1, seconds=1.0)
    np.testing.assert_array_equal(run(weightless(CapstanFriction(1, wrap=0.5)), plan).q, run(weightless(), plan).q)


@pytest.mark.parametrize("phase", [-6.0, -3.0, 0.5, 3.0, 6.0])
@pytest.mark.parametrize("swing", [-0.2, 0.2])
def test_a_wave_is_written_in_one_way(swing: float, phase: float) -> None:
    """Size upwards and phase within half a turn: another number for each, and the same friction and eccentricity."""
    state = motion()
    friction = PositionDependentFriction(1, torque=0.3, swing=swing, waves=12.0, phase=phase)
    wheel = PulleyEccentricity(1, amplitude=swing / 10, waves=12.0, phase=phase)
    assert friction.canonical().swing == wheel.canonical().amplitude * 10 == 0.2
    assert max(abs(friction.canonical().phase), abs(wheel.canonical().phase)) <= np.pi
    x = np.linspace(-2.0, 2.0, 50)
    laws = [one.law() for one in (friction, friction.canonical())]
    np.testing.assert_allclose(*(w.swing * np.sin(w.waves * x + w.phase) for w in laws), atol=1e-12)
    np.testing.assert_allclose(*(w.act(state.position, state) for w in (wheel, wheel.canonical())), atol=1e-9)


def test_position_dependent_friction_follows_its_wave():
    """At a steady speed the friction swings with the position as the law says, and changes sign with the direction."""
    effect = PositionDependentFriction(1, torque=1.0, swing=0.4, waves=4.0, phase=0.3)
    for speed in (0.2, -0.2):
        plan = constant_speed(np.array([speed, 0.0, 0.0]), seconds=10.0)
        outcome = run(weightless(effect), plan)
        friction = outcome.torque[200:, 0, 0] * np.sign(speed)
        expected = 1.0 + 0.4 * np.sin(4.0 * outcome.q[200:, 0, 0] + 0.3)
        np.testing.assert_allclose(friction, expected, atol=0.02)


def test_friction_is_never_negative():
    """Where the wave would make it negative there is none: the joint is not driven by its friction."""
    effect = PositionDependentFriction(1, torque=0.1, swing=0.5, waves=4.0, phase=0.0)
    plan = constant_speed(np.array([0.2, 0.0, 0.0]), seconds=8.0)
    assert run(weightless(effect), plan).torque[100:, 0, 0].min() > -0.02


def test_saturation_has_a_threshold():
    """Below its limit it changes nothing at all; above, the motor accelerates at limit over inertia and no faster."""
    plan = moves(runs=1, seconds=2.0)
    free = run(weightless(), plan)
    peak = np.abs(free.torque[..., 0]).max()
    np.testing.assert_array_equal(run(weightless(TorqueSaturation(1, 1.01 * peak)), plan).q, free.q)
    cut = run(weightless(TorqueSaturation(1, 0.3 * peak)), plan)
    assert np.abs(cut.q - free.q)[..., 0].max() > 1e-3
    acceleration = np.diff(cut.motion.velocity[:, 0, 0]) * RATE_HZ
    assert np.abs(acceleration).max() <= 0.3 * peak / drive().motor_inertia[0] * (1 + 1e-9)


def test_saturation_does_not_hide_what_was_commanded():
    """The reported effort is the controller's wish, beyond what the motor gives."""
    q = np.array([0.6, 1.5, 0.36])
    needed = abs(run(raven(drive=drive("gravity")), hold(q)).torque[-1, 0, 1])
    weak = run(raven(TorqueSaturation(2, 0.5 * needed), drive=drive("gravity")), hold(q))
    assert np.abs(weak.torque[-1, 0, 1]) > 0.6 * needed


@pytest.mark.parametrize(("end", "sign"), [("upper", 1.0), ("lower", -1.0)])
def test_a_stop_is_one_sided(end, sign):
    """Short of its limit a stop changes nothing; beyond it the joint hangs back by k / (kp + k) of the way."""
    k = 500.0
    effect = JointStop(1, k, sign * 0.1, end)
    short = hold(np.array([sign * 0.099, 0.0, 0.0]))
    np.testing.assert_array_equal(run(weightless(effect), short).q, run(weightless(), short).q)
    beyond = hold(np.array([sign * 0.2, 0.0, 0.0]), seconds=4.0)
    reached = run(weightless(effect), beyond).q[-1, 0, 0]
    assert sign * (0.2 - abs(reached)) * sign == pytest.approx(0.1 * k / (KP[0] + k), rel=1e-3)
    far = hold(np.array([-sign * 0.5, 0.0, 0.0]))
    np.testing.assert_array_equal(run(weightless(effect), far).q, run(weightless(), far).q)


def test_a_stretching_cable_lets_the_motor_go_on():
    """The stop's torque is carried by the cable: the joint stands behind its motor by torque over stiffness."""
    stop, cable = JointStop(1, 80.0, 0.1), CableStretch(1, 100.0)
    outcome = run(weightless(stop, cable), hold(np.array([0.2, 0.0, 0.0]), seconds=4.0))
    motor, joint = outcome.motion.position[-1, 0, 0], outcome.q[-1, 0, 0]
    pressed = 80.0 * (motor - 0.1)
    assert pressed > 1.0
    assert motor - joint == pytest.approx(pressed / 100.0, rel=1e-6)


def test_a_stop_too_stiff_for_the_step_is_refused():
    """A stop that the sampled loop could not follow is named before it throws the joint about."""
    with pytest.raises(DataError, match="stops"):
        run(weightless(JointStop(1, 1e7, 0.1)), hold(np.array([0.2, 0.0, 0.0])))


def test_a_hidden_payload_is_a_payload():
    """The effect loads the arm as a known payload does, and only the feedforward does not know of it."""
    plan = moves(runs=1, seconds=1.0)
    hidden = run(raven(Payload("all", 0.3)), plan)
    known = run(raven(), moves(runs=1, seconds=1.0, payload=0.3))
    np.testing.assert_allclose(hidden.q, known.q, atol=1e-6)
    np.testing.assert_allclose(hidden.motion.tip_force, known.motion.tip_force)
