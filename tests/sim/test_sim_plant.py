from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sim_machines import RATE_HZ, constant_speed, drive, hold, moves, raven, weightless

from gpcorrect.arms import Chain, Joint, arm_named
from gpcorrect.sim import Machine, Segment, plan_of, run, simulate
from gpcorrect.sim.body import Body, Drive, Links
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import (
    Backlash,
    CableStretch,
    CoulombFriction,
    GravitySag,
    HomingOffset,
    Payload,
    ViscousFriction,
)
from gpcorrect.sim.plan import minimum_jerk
from gpcorrect.sim.plant import Command, follow_command


def test_a_perfect_machine_goes_where_it_is_told():
    """No effect, no noise, whole feedforward: measured, true and desired joints agree, and so do the poses."""
    plan = moves()
    log = simulate(raven(drive=drive("rigid-body")), plan)
    scale = np.ptp(log.setpoint_jp, axis=0)
    assert (np.abs(log.measured_jp - log.setpoint_jp).max(axis=0) < 5e-4 * scale).all()
    np.testing.assert_array_equal(log.external_jp, log.measured_jp)
    np.testing.assert_allclose(log.tracker_cp.position, log.measured_cp.position, atol=1e-12)
    np.testing.assert_allclose(np.abs((log.tracker_cp.quaternion * log.measured_cp.quaternion).sum(1)), 1.0)
    arm = arm_named("raven2_left")
    q = np.concatenate([log.setpoint_jp, np.zeros((len(log), 3))], axis=1)
    np.testing.assert_allclose(log.setpoint_cp.position, arm.forward(q)[:, :3, 3], atol=1e-12)


def test_feedforward_takes_the_load_off_the_gains():
    """The more of the load is fed forward, the smaller the tracking error."""
    plan = moves()
    errors = [
        np.abs(run(raven(drive=drive(kind)), plan).motion.position - plan.q).max()
        for kind in ("none", "gravity", "rigid-body")
    ]
    assert errors[0] > 1.5 * errors[1]
    assert errors[1] > 3 * errors[2]


def test_stretch_at_rest_is_load_over_stiffness():
    """A held joint hangs tau / k behind its motor, tau being the gravity torque where it hangs."""
    q, k = np.array([0.6, 1.5, 0.36]), 60.0
    machine = raven(CableStretch(2, k), drive=drive("gravity"))
    outcome = run(machine, hold(q), passes=8)
    tau = posture_at(machine.body, outcome.q[-1:, :1]).gravity_load()[0, 0, 1]
    np.testing.assert_allclose(outcome.motion.position[-1, 0, 1] - outcome.q[-1, 0, 1], tau / k, rtol=1e-8)


def test_motion_and_load_converge():
    """Every further pass changes the path by a fraction of what the one before did, down to rounding."""
    effects = (CableStretch(2, 120.0), CoulombFriction(1, torque=1.0), ViscousFriction(2, damping=1.0))
    machine, plan = raven(*effects), moves()
    paths = [run(machine, plan, passes=p).q for p in (1, 2, 3, 4)]
    changes = [np.sqrt(((b - a) ** 2).mean()) for a, b in pairwise(paths)]
    assert changes[1] < 0.2 * changes[0]
    assert changes[2] < 0.2 * changes[1]
    assert changes[1] < 1e-5


LIGHT, HEAVY = 0.05, 0.1  # kg m^2


def discs():
    """Two coaxial discs on motors without rotors, a light one that carries a heavy one, and a plan to and fro."""
    links = Links(np.ones(2), np.zeros((2, 3)), np.array([[0.0, 0.0, LIGHT], [0.0, 0.0, HEAVY]]), np.zeros(1))
    joint = Joint("R", 0.0, 0.0, 0.0, 0.0, -3.0, 3.0)
    body = Body((1, 2), "RR", Chain((joint, joint), "modified"), np.zeros(0), links, np.zeros(3))
    motors = Drive(np.array([20.0, 10.0]), np.array([2.0, 1.0]), np.zeros(2), 4000.0)
    part = minimum_jerk(0.7, RATE_HZ)
    wave = np.concatenate([part, 1.0 - part[1:], part[1:]])
    plan = plan_of([Segment(wave[:, None] * [0.4, -0.3], np.zeros(len(wave), dtype=np.int64))], RATE_HZ)
    return Machine("discs", body, motors, RATE_HZ), plan


def test_links_that_turn_one_another_go_where_an_exact_solver_has_them():
    """Each torque turns both discs."""
    machine, plan = discs()
    spline, turned = plan.spline(), np.linalg.inv([[LIGHT + HEAVY, HEAVY], [HEAVY, HEAVY]])
    kp, kd = machine.drive.kp, machine.drive.kd

    def law(t, x):
        return np.concatenate([x[2:], turned @ (kp * (spline(t)[0] - x[:2]) + kd * (spline(t, 1)[0] - x[2:]))])

    t = np.arange(len(plan.q)) / RATE_HZ
    exact = solve_ivp(law, (0.0, t[-1]), np.zeros(4), t_eval=t, rtol=1e-9, atol=1e-12, max_step=0.01).y[:2].T
    lag = np.sqrt(((exact - plan.q[:, 0]) ** 2).mean(axis=0))
    off, in_two = (np.sqrt(((run(machine, plan, p).q[:, 0] - exact) ** 2).mean(axis=0)) / lag for p in (None, 2))
    assert (off < 0.03).all()
    assert (in_two > 0.1).any()


def test_runs_with_effects_take_as_many_passes_whatever_their_numbers():
    """Else what an effect does would jump with its numbers. They begin with the run of the machine without them."""
    machine, plan = discs()
    command = Command.of(machine, plan)
    own = follow_command(machine, command)
    begun = replace(command, begun=own)
    taken = {
        follow_command(machine.with_effects(ViscousFriction(1, damping=d)), begun).passes for d in (1e-3, 0.1, 1.0)
    }
    assert own.passes > 4
    assert taken == {own.passes // 2}


def test_runs_do_not_disturb_each_other():
    """A run comes out the same alone and beside others."""
    plan = moves(runs=3)
    alone = plan.of_runs(np.array([0]))
    machine = raven(CoulombFriction(1, torque=1.0), Backlash(3, 0.001))
    np.testing.assert_allclose(run(machine, alone).q[:, 0], run(machine, plan).q[:, 0], atol=2e-6)


def test_payload_pulls_a_soft_arm_down():
    """More payload, more sag, in proportion at a fixed pose."""
    q = np.array([0.6, 1.5, 0.33])
    sags = []
    for payload in (0.0, 0.2, 0.4):
        outcome = run(raven(GravitySag(2, 200.0), drive=drive("gravity")), hold(q, payload=payload), passes=8)
        sags.append(outcome.motion.position[-1, 0, 1] - outcome.q[-1, 0, 1])
    np.testing.assert_allclose(sags[2] - sags[1], sags[1] - sags[0], rtol=0.02)
    assert abs(sags[1] - sags[0]) > 1e-4


def test_homing_offset_shows_outside_only():
    """The controller works on what it reports: a homing offset leaves measured joints right and true ones wrong."""
    plan = constant_speed(np.array([0.05, 0.05, 0.0]))
    log = simulate(weightless(HomingOffset(1, 0.1)), plan)
    np.testing.assert_allclose(log.measured_jp, log.setpoint_jp, atol=1e-9)
    np.testing.assert_allclose((log.measured_jp - log.external_jp)[:, 0], 0.1, atol=1e-12)


def test_a_load_effect_is_unknown_to_the_controller():
    """Payload as an effect loads the arm but not the feedforward; known payload loads both."""
    q = np.array([0.6, 1.5, 0.33])
    hidden = run(raven(Payload("all", 0.3), drive=drive("gravity")), hold(q), passes=6)
    known = run(raven(drive=drive("gravity")), hold(q, payload=0.3), passes=6)
    np.testing.assert_allclose(known.motion.position[-1, 0], q, atol=1e-6)
    sag = q - hidden.motion.position[-1, 0]
    expected = (hidden.motion.gravity_load[-1, 0] - run(raven(), hold(q)).motion.gravity_load[-1, 0]) / drive().kp
    np.testing.assert_allclose(sag, expected, atol=2e-5)
    assert np.abs(sag).max() > 1e-4


MASS, LENGTH, MOTOR, GRAVITY = 0.8, 0.2, 0.3, 9.81
LINK = MASS * LENGTH**2
KP, KD, STIFFNESS, CABLE_DAMPING = 900.0, 30.0, 250.0, 0.5


def pendulum() -> Machine:
    """One revolute joint with a point mass, hanging below a horizontal axis at zero, behind a cable that stretches."""
    joint = Joint("R", 0.0, 0.0, 0.0, 0.0, -3.0, 3.0)
    links = Links(np.array([MASS]), np.array([[LENGTH, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros(1))
    body = Body((1,), "R", Chain((joint,), "modified"), np.zeros(0), links, np.array([GRAVITY, 0.0, 0.0]))
    drive = Drive(np.array([KP]), np.array([KD]), np.array([MOTOR]))
    return Machine("pendulum", body, drive, RATE_HZ, (CableStretch(1, STIFFNESS),))


def sweep():
    """Slow moves to both sides, with a rest in between."""
    there, rest = 1.2 * minimum_jerk(1.5, RATE_HZ), np.full(50, 1.2)
    back = 1.2 - 2.0 * minimum_jerk(2.0, RATE_HZ)
    q = np.concatenate([np.zeros(20), there, rest, back, np.full(50, -0.8)])[:, None]
    return plan_of([Segment(q, np.zeros(len(q), dtype=np.int64))], RATE_HZ)


def two_masses(plan):
    """Motor and link angles at the samples, by an adaptive integrator."""
    spline, speed = plan.spline(), plan.spline().derivative()

    def rates(t, state):
        motor, link, v_motor, v_link = state
        cable = STIFFNESS * (motor - link) + CABLE_DAMPING * (v_motor - v_link)
        drive = KP * (spline(t)[0, 0] - motor) + KD * (speed(t)[0, 0] - v_motor)
        weight = MASS * GRAVITY * LENGTH * np.sin(link)
        return [v_motor, v_link, (drive - cable) / MOTOR, (cable - weight) / LINK]

    times = np.arange(len(plan.q)) / RATE_HZ
    solution = solve_ivp(rates, (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-8, atol=1e-10, max_step=0.01)
    return solution.y[0], solution.y[1]


@pytest.fixture(scope="module")
def paths():
    plan = sweep()
    return run(pendulum(), plan, passes=4), two_masses(plan)


def test_the_motor_agrees_with_two_masses(paths):
    """The motor's path is the same to a few per cent of its own tracking error."""
    outcome, (motor, _) = paths
    error = np.abs(outcome.motion.position[:, 0, 0] - motor).max()
    assert error < 0.05 * np.abs(motor - sweep().q[:, 0, 0]).max()


def test_the_stretch_agrees_with_two_masses(paths):
    """The cable's stretch, gravity and inertia together, is the same to a few per cent."""
    outcome, (motor, link) = paths
    stretch = (outcome.motion.position - outcome.q)[:, 0, 0]
    assert np.abs(stretch).max() > 4e-3
    assert np.abs(stretch - (motor - link)).max() < 0.08 * np.abs(stretch).max()


def test_at_rest_two_masses_stand_where_ours_do(paths):
    """Once the arm rests, both give the same equilibrium."""
    outcome, (motor, link) = paths
    assert (outcome.motion.position - outcome.q)[-1, 0, 0] == pytest.approx((motor - link)[-1], rel=1e-3)
