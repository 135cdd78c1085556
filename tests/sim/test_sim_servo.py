from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, cont2discrete, lsim
from sim_machines import INERTIA, RATE_HZ, constant_speed, drive, hold, moves, raven, weightless

from gpcorrect.errors import DataError
from gpcorrect.sim import Segment, plan_of, run
from gpcorrect.sim.body import Drive
from gpcorrect.sim.effects import (
    CoulombFriction,
    IntegralAction,
    StribeckFriction,
    TorqueSaturation,
    VelocityFilter,
    ViscousFriction,
)
from gpcorrect.sim.plan import minimum_jerk
from gpcorrect.sim.servo import Clock, Loop, Reference, ServoPath, follow
from gpcorrect.sim.servo_steps import State

SPEED = np.array([0.1, -0.2, 0.01])
ALL = (1, 2, 3)
SIDED = ((1, "motor"), (2, "joint"))


def released(*effects, kd=0.0, seconds=4.0, rate_hz=1000.0, amplitude=0.1):
    """One joint (column 0 of three alike) let go from rest, `amplitude` away from where its spring holds it."""
    spring = Drive(np.full(3, 10.0), np.full(3, kd), np.full(3, 0.1), rate_hz)
    every = Clock(1.0 / rate_hz, 1)
    stride = round(rate_hz / RATE_HZ)
    steps = round(seconds * RATE_HZ) * stride + 1
    still, zero = np.zeros((1, steps, 3)), np.zeros((steps, 1, 3))
    pull = zero.copy()
    pull[0] = -10.0 * amplitude  # balanced at the start, gone at the first step
    path = follow(spring, Reference(still, still, zero, pull, np.full(3, 0.1)), every, ALL, effects)
    return ServoPath(*(values[::stride] for values in path))


@pytest.mark.parametrize(("filtered", "rate"), [(0.0, 0.0), (0.01, 0.0), (0.0, 3.0)])
def test_linear_loop_agrees_with_an_exact_solver(filtered, rate):
    """Without friction the loop, its filter and its integral are a linear system: scipy's solver has the same path."""
    plan, machine = moves(runs=1), weightless(drive=drive(rate_hz=4000.0))
    hidden = VelocityFilter("all", filtered), IntegralAction("all", rate)
    outcome, d = run(machine.with_effects(*hidden), plan), machine.drive
    spline = plan.spline()
    t = np.arange(len(plan.q) * 40) / (RATE_HZ * 40)
    t = t[t <= (len(plan.q) - 1) / RATE_HZ]
    for j in range(3):
        kp, kd = d.kp[j] / INERTIA[j], d.kd[j] / INERTIA[j]
        late = 1.0 / filtered if filtered else 0.0
        motion = [[0, 1, 0, 0], [-kp, -kd * (late == 0.0), -kd * (late > 0.0), 1], [0, late, -late, 0]]
        motion.append([-kp * rate, 0, 0, 0])
        system = StateSpace(motion, [[0, 0], [1, 0], [0, 0], [0, 1]], np.eye(4), np.zeros((4, 2)))
        wanted, first = spline(t)[:, 0, j], spline(0.0, 1)[0, j]
        given = np.stack([kp * wanted + kd * spline(t, 1)[:, 0, j], kp * rate * wanted], axis=1)
        _, exact, _ = lsim(system, given, t, X0=[plan.q[0, 0, j], first, first, 0.0])
        scale = np.ptp(plan.q[..., j])
        np.testing.assert_allclose(outcome.q[:, 0, j], exact[::40, 0][: len(plan.q)], atol=2e-4 * scale)


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_a_sampled_controller_holds_its_torque(rate_hz):
    """At any rate the motor goes where scipy's zero-order hold says that a mass goes under a torque that is held."""
    kp, kd, mass, step = 10.0, 0.7, 0.1, 1.0 / rate_hz
    A, B, *_ = cont2discrete((np.diag([1.0], 1), np.array([[0.0], [1.0 / mass]]), np.eye(2), np.zeros((2, 1))), step)
    path = released(kd=kd, seconds=1.0, rate_hz=rate_hz)
    state, expected = np.array([path.position[1, 0, 0], path.velocity[1, 0, 0]]), []  # from where the pull is gone
    for _ in range(round(rate_hz)):
        expected.append(state[0])
        state = A @ state + B[:, 0] * (-kp * state[0] - kd * state[1])
    reached = path.position[1:, 0, 0]
    np.testing.assert_allclose(reached, expected[:: round(rate_hz / RATE_HZ)][: len(reached)], atol=1e-12)


@pytest.mark.parametrize(("mass", "damping", "kp", "kd"), [(0.1, 0.7, 10.0, 0.7), (0.001, 0.5, 12.0, 0.3)])
def test_viscous_friction_acts_within_a_step(mass, damping, kp, kd):
    """A damped mass goes where scipy's zero-order hold says, light joints too, whose speed a step takes half of."""
    step, n = 1e-3, 600
    t = np.arange(n) * step
    wanted, pace = 0.3 * np.sin(9.0 * t), 2.7 * np.cos(9.0 * t)
    still, one = np.zeros((n, 1, 1)), np.ones(1)
    given = Reference(wanted[None, :, None], pace[None, :, None], still, still, mass * one)
    drives = Drive(kp * one, kd * one, mass * one, 1.0 / step)
    path = follow(drives, given, Clock(step, 1), (1,), [ViscousFriction(1, damping=damping)])
    moves_by = np.array([[0.0, 1.0], [0.0, -damping / mass]]), np.array([[0.0], [1.0 / mass]])
    A, B, *_ = cont2discrete((*moves_by, np.eye(2), np.zeros((2, 1))), step)
    state, expected = np.array([path.position[0, 0, 0], path.velocity[0, 0, 0]]), []
    for q, v in zip(wanted, pace, strict=True):
        expected.append(state[0])
        state = A @ state + B[:, 0] * (kp * (q - state[0]) + kd * (v - state[1]))
    lag = np.abs(expected - wanted).max()
    np.testing.assert_allclose(path.position[:, 0, 0], expected, atol=1e-3 * lag)


@pytest.mark.parametrize("effects", [(), (TorqueSaturation(1, limit=0.03),)])
def test_a_run_that_begins_where_another_has_been_goes_on_as_that(effects):
    """Position and speed are the whole state of such a loop: saturated or not, it does not matter how it came there."""
    plan, machine, k = moves(runs=2), weightless(*effects), 40
    whole = run(machine, plan).motion
    begins = np.stack([whole.position[k], whole.velocity[k]])
    rest = run(machine, replace(plan, q=plan.q[k:], trajectory=plan.trajectory[k:], begins=begins)).motion
    balanced = run(machine, replace(plan, q=plan.q[k:], trajectory=plan.trajectory[k:])).motion
    off, ever = (np.abs(m.position - whole.position[k:])[..., 0].max() for m in (rest, balanced))
    assert off < 1e-3 * ever


@pytest.mark.parametrize("rest", ["dry", "soft"])
def test_torque_behind_the_cable_is_shared_out(rest):
    """With friction on both sides the cable feels only its own part."""
    sides = {"joint": 0.4, "motor": 0.2}
    both = [CoulombFriction(1, torque=f, side=side, rest=rest, onset=0.01) for side, f in sides.items()]
    viscous = (ViscousFriction(1, damping=2.0, side="joint"), ViscousFriction(1, damping=3.0, side="motor"))
    outcome = run(weightless(*both, *viscous), constant_speed(SPEED))
    np.testing.assert_allclose(outcome.motion.load[-1, 0, 0], 0.4 + 2.0 * SPEED[0], rtol=1e-6)


def test_a_push_below_the_limit_does_not_move_a_stuck_joint():
    """Under dry friction a command whose spring force stays below Fc moves nothing at all, not even slowly."""
    ramp = 0.9 * 1.0 / drive().kp[0] * minimum_jerk(1.0, RATE_HZ)
    q = np.zeros((400, 3))
    q[:, 0] = np.pad(ramp, (50, 400 - 50 - len(ramp)), mode="edge")
    plan = plan_of([Segment(q, np.zeros(400, dtype=np.int64))], RATE_HZ)
    stuck = run(weightless(CoulombFriction(1, torque=1.0)), plan)
    assert np.ptp(stuck.q[..., 0]) < 1e-30  # the first sample's speed is not quite 0
    assert np.ptp(run(weightless(CoulombFriction(1, torque=0.8)), plan).q[..., 0]) > 0.0


def test_coulomb_oscillator_loses_two_fc_over_kp_each_half_swing():
    """A spring and mass under dry friction swing ever less, by 2 Fc / k a half period, and stop within Fc / k."""
    torque, stiffness = 0.05, 10.0
    path = released(CoulombFriction(1, torque=torque), rate_hz=20000.0).position[:, 0, 0]
    half = np.pi * np.sqrt(0.1 / stiffness) * RATE_HZ
    peaks = np.abs([path[round(i * half)] for i in range(5)])
    np.testing.assert_allclose(np.diff(peaks), -2 * torque / stiffness, atol=4e-4)
    assert abs(path[-1]) <= torque / stiffness + 1e-12
    assert np.ptp(path[-50:]) == 0.0


@pytest.mark.parametrize(
    "friction",
    [
        CoulombFriction(1, torque=0.05),
        CoulombFriction(1, torque=0.05, rest="soft", onset=0.05, onset_time=0.0),
        StribeckFriction(1, torque=0.04, static_torque=0.08, speed=0.1, rest="soft", onset=0.02, onset_time=0.0),
        ViscousFriction(1, damping=0.05),
    ],
    ids=["coulomb", "soft", "soft stribeck", "viscous"],
)
def test_friction_is_passive(friction):
    """Friction never feeds energy: what spring and mass hold together only falls, and without it stays."""
    energy = {}
    for name, effects in (("free", ()), ("slowed", (friction,))):
        path = released(*effects, rate_hz=20000.0)
        energy[name] = 0.5 * 10.0 * path.position[:, 0, 0] ** 2 + 0.5 * 0.1 * path.velocity[:, 0, 0] ** 2
    ripple = 0.01 * energy["free"][0]
    np.testing.assert_allclose(energy["free"], energy["free"][0], atol=ripple)
    assert (np.diff(energy["slowed"]) < ripple).all()
    assert energy["slowed"][-1] < 0.5 * energy["slowed"][0]


def soft(torque, onset, onset_time=0.0, **keys):
    """Friction of joint 1 that grows over the first speeds."""
    return CoulombFriction(1, torque=torque, rest="soft", onset=onset, onset_time=onset_time, **keys)


def pushed(push, *effects, seconds=2.0):
    """Speeds `(n,)` of joint 1 under a constant torque, from rest, at steps of 1 ms; its spring is next to nothing."""
    n = round(seconds * 1000.0) + 1
    still, zero = np.zeros((1, n, 3)), np.zeros((n, 1, 3))
    loop = Loop(Drive(np.full(3, 1e-9), np.zeros(3), np.full(3, 0.1)), ALL, effects)
    reference = Reference(still, still, zero, zero - push, np.full(3, 0.1))
    return loop.run(reference, Clock(1e-3, 1), State(*np.zeros((5, 1, 3)))).velocity[:, 0, 0]


@pytest.mark.parametrize("onset_time", [0.0, 0.0095])
def test_soft_friction_creeps_in_proportion_to_the_load(onset_time):
    """Under half its limit a joint creeps at half the onset, and under more than the limit it is off."""
    np.testing.assert_allclose(pushed(0.2, soft(0.4, 0.01, onset_time))[-1], 0.005, rtol=1e-6)
    np.testing.assert_allclose(pushed(0.5, soft(0.4, 0.01, onset_time))[-1], 2.0 * 0.1 / 0.1, rtol=0.02)


@pytest.mark.parametrize("push", [0.5, 0.7])
def test_soft_friction_falls_with_speed_as_its_law_says(push):
    """It creeps up to the static limit and runs away past it, as an integrator of the law alone has it."""
    law = {"torque": 0.3, "static_torque": 0.6, "speed": 0.05}
    friction = StribeckFriction(1, **law, rest="soft", onset=0.01, onset_time=0.0)

    def faster(_, v):
        return (push - min(60.0 * v[0], 0.3 + 0.3 * np.exp(-((v[0] / 0.05) ** 2)))) / 0.1

    wanted = solve_ivp(lambda t, v: [faster(t, v)], (0.0, 0.1), [0.0], rtol=1e-9, atol=1e-12, max_step=1e-4).y[0, -1]
    np.testing.assert_allclose(pushed(push, friction, seconds=0.1)[-1], wanted, rtol=0.03)


def test_soft_frictions_on_one_joint_add_up():
    """Two creep as one of both limits with the same onset does, and beside dry friction that holds nothing moves."""
    one, two = pushed(0.2, soft(0.4, 0.01)), pushed(0.2, soft(0.1, 0.01, side="joint"), soft(0.3, 0.01))
    np.testing.assert_allclose(two, one, atol=1e-15)
    dry = CoulombFriction(1, torque=0.25)
    assert not pushed(0.2, soft(0.4, 0.01), dry).any()
    np.testing.assert_allclose(pushed(0.35, soft(0.4, 0.01), dry)[-1], 0.0025, rtol=1e-6)


def test_soft_friction_without_an_onset_is_dry():
    """As the onset goes to zero, within a step, the path goes to that of dry friction, stick and slip included."""
    plan, dry = moves(runs=2, seconds=3.0), CoulombFriction(1, torque=2.0)
    paths = [run(weightless(e), plan).q for e in (dry, soft(2.0, 1e-12), soft(2.0, 0.0), soft(2.0, 0.05))]
    np.testing.assert_allclose(paths[1], paths[0], atol=1e-11)
    np.testing.assert_array_equal(paths[2], paths[0])
    assert np.abs(paths[3] - paths[0]).max() > 1e-4


@pytest.mark.parametrize("onset", [1e-9, 1e-4, 0.01])
@pytest.mark.parametrize("onset_time", [0.0, 3e-4, 0.0095])
def test_soft_friction_is_stable_at_any_step(onset, onset_time):
    """A joint that was let go never swings past zero speed and back within a few steps, however short the onset."""
    velocity = released(soft(0.5, onset, onset_time)).velocity[:, 0, 0]
    turns = np.flatnonzero(np.diff(np.sign(velocity[np.abs(velocity) > 1e-12])))
    assert len(turns) < 8
    assert np.abs(velocity[-50:]).max() < 0.05


def test_halving_the_step_halves_the_error():
    """The loop converges, first order, as its rate grows: stick and slip included."""
    effects = (CoulombFriction(1, torque=2.0), ViscousFriction(2, damping=2.0))
    plan = moves(runs=2, seconds=3.0)
    paths = [run(weightless(*effects, drive=drive(rate_hz=rate)), plan).q for rate in (500.0, 1000.0, 2000.0, 16000.0)]
    errors = [np.sqrt(((path - paths[-1]) ** 2).mean()) for path in paths[:-1]]
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_torque_is_what_the_motion_takes():
    """The commanded torque covers load, friction and the motor's own acceleration (momentum balance)."""
    plan = moves(runs=1)
    outcome = run(raven(ViscousFriction(1, damping=2.0), inertia=0.0), plan, passes=4)
    acceleration = np.gradient(outcome.motion.velocity, 1 / RATE_HZ, axis=0)
    friction = np.zeros(plan.q.shape)
    friction[..., 0] = 2.0 * outcome.motion.velocity[..., 0]
    balance = outcome.torque - outcome.motion.load - friction - INERTIA * acceleration
    scale = np.abs(outcome.torque).max(axis=(0, 1))
    assert (np.abs(balance[2:-2]).max(axis=(0, 1)) < 0.02 * scale).all()


def test_a_held_arm_sags_by_gravity_over_gain():
    """Without feedforward the motors hold the arm g / kp away from where they should."""
    q = np.array([0.6, 1.5, 0.36])
    outcome = run(raven(), hold(q), passes=6)
    sag = q - outcome.motion.position[-1, 0]
    np.testing.assert_allclose(sag, outcome.motion.gravity_load[-1, 0] / drive().kp, rtol=1e-6)


def test_unstable_gains_are_refused():
    """A sampled loop that would blow up is named before it does."""
    wild = Drive(np.full(3, 1e6), np.full(3, 1.0), np.full(3, 0.01))
    with pytest.raises(DataError, match="unstable"):
        run(weightless(drive=wild), moves(runs=1, seconds=1.0))


@pytest.mark.parametrize("log_rate", [30.0, 100.0, 333.0, 2000.0])
def test_clock_meets_the_log(log_rate):
    """The loop runs at its rate or as little faster as makes whole steps between log samples."""
    clock = Clock.of(1000.0, log_rate)
    assert clock.step * clock.stride == pytest.approx(1 / log_rate)
    assert 1000.0 <= 1 / clock.step + 1e-6 < 1000.0 + max(log_rate, 1000.0) + 1


@pytest.mark.parametrize("kv", [None, 20.0])
@pytest.mark.parametrize("bristle", [20.0, 300.0])
def test_friction_that_bends_is_dahls(bristle, kv):
    """A joint that goes to and fro moves as scipy says with a bristle of Dahl's."""
    kp, kd, mass, step = 200.0, 20.0, 0.5, 2e-4
    t = np.arange(0.0, 3.0, step)
    desired, rate = 0.3 * (1.0 - np.cos(np.pi * t)), 0.3 * np.pi * np.sin(np.pi * t)

    def slopes(time, state):
        position, velocity, force = state
        error, pace = 0.3 * (1.0 - np.cos(np.pi * time)) - position, 0.3 * np.pi * np.sin(np.pi * time)
        drive = kp * error + (kd * (pace - velocity) if kv is None else -kv * velocity)
        return [velocity, (drive - force) / mass, bristle * (velocity - abs(velocity) * force / 2.0)]

    exact = solve_ivp(slopes, (0.0, t[-1]), np.zeros(3), t_eval=t, method="LSODA", rtol=1e-8, atol=1e-10).y[0]
    gains = {"kv": None if kv is None else np.array([kv])}
    motor = Drive(np.array([kp]), np.array([kd if kv is None else 0.0]), np.array([mass]), 1.0 / step, **gains)
    zero = np.zeros((len(t), 1, 1))
    reference = Reference(desired[None, :, None], rate[None, :, None], zero, zero, np.array([mass]))
    found = [
        follow(motor, reference, Clock(step, 1), (1,), [CoulombFriction(joint=1, torque=2.0, **rest)]).position[:, 0, 0]
        for rest in ({}, {"rest": "elastic", "bristle": bristle})
    ]
    dry, bent = (float(np.abs(path - exact).max()) for path in found)
    assert bent < 1e-4 < 3e-3 < dry


def test_a_bristle_behind_the_transmission_loads_it():
    """What the bristles hold with is the torque behind the transmission where they are there, and none before it."""
    friction = [CoulombFriction(joint=j, torque=0.5, rest="elastic", bristle=40.0, side=s) for j, s in SIDED]
    path = released(*friction, kd=0.2)
    assert np.abs(path.joint_friction[:, 0, 0]).max() == 0.0
    assert 0.4 < np.abs(path.joint_friction[:, 0, 1]).max() <= 0.5
    np.testing.assert_array_equal(path.position[..., 0], path.position[..., 1])


@pytest.mark.parametrize("bristle", [0.0, np.inf])
def test_friction_without_a_bristle_is_dry(bristle):
    """What has none, or one that does not give, sticks; nothing comes of it that is no number."""
    elastic, dry = (
        released(CoulombFriction(joint=1, torque=0.5, **rest), kd=0.2).position
        for rest in ({"rest": "elastic", "bristle": bristle}, {})
    )
    np.testing.assert_array_equal(elastic, dry)
