"""The quasi-static cable against an independent simulation: motor and link as two masses joined by a spring."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sim_machines import RATE_HZ

from gpcorrect.arms import Chain, Joint
from gpcorrect.sim import Machine, Segment, plan_of, run
from gpcorrect.sim.body import Body, Drive, Links
from gpcorrect.sim.effects import CableStretch
from gpcorrect.sim.plan import minimum_jerk

MASS, LENGTH, MOTOR, GRAVITY = 0.8, 0.2, 0.3, 9.81
LINK = MASS * LENGTH**2
KP, KD, STIFFNESS, CABLE_DAMPING = 900.0, 30.0, 250.0, 0.5


def pendulum() -> Machine:
    """One revolute joint with a point mass, hanging below a horizontal axis at zero."""
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


def test_motor_agrees(paths):
    """The motor's path is the same to a few per cent of its own tracking error."""
    outcome, (motor, _) = paths
    error = np.abs(outcome.motion.position[:, 0, 0] - motor).max()
    assert error < 0.05 * np.abs(motor - sweep().q[:, 0, 0]).max()


def test_stretch_agrees(paths):
    """The cable's stretch, gravity and inertia together, is the same to a few per cent."""
    outcome, (motor, link) = paths
    stretch = (outcome.motion.position - outcome.q)[:, 0, 0]
    assert np.abs(stretch).max() > 4e-3
    assert np.abs(stretch - (motor - link)).max() < 0.08 * np.abs(stretch).max()


def test_stretch_at_rest_agrees_exactly(paths):
    """Once the arm rests, both give the same equilibrium."""
    outcome, (motor, link) = paths
    assert (outcome.motion.position - outcome.q)[-1, 0, 0] == pytest.approx((motor - link)[-1], rel=1e-3)
