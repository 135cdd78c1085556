"""A gear or a cable's coupling that is not as told hands on torque as it hands on motion: no work is lost or won."""

from __future__ import annotations

import numpy as np
import pytest
from sim_machines import drive, hold, raven

from gpcorrect.sim import run
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import CableCoupling, Effect, TransmissionRatio
from gpcorrect.sim.live import LiveArm
from gpcorrect.types import FloatArray

PLACE = np.array([0.6, 1.5, 0.36])


def at_rest(*effects: Effect) -> tuple[FloatArray, FloatArray]:
    """Torque of the motors, and of the links where they hang."""
    machine = raven(*effects, drive=drive("gravity"))
    outcome = run(machine, hold(PLACE), passes=8)
    return outcome.torque[-1, 0], posture_at(machine.body, outcome.q[-1:, :1]).gravity_load()[0, 0]


def test_a_gear_makes_more_torque_where_it_makes_less_motion() -> None:
    """Motors hold the joint with a tenth less where they turn a tenth more; a wrong reading leaves the torque."""
    motors, links = at_rest(TransmissionRatio(2, 0.1, home=1.2, of="gear"))
    np.testing.assert_allclose(motors, links / [1.0, 1.1, 1.0], rtol=1e-7)
    motors, links = at_rest(TransmissionRatio(2, 0.1, home=1.2))
    np.testing.assert_allclose(motors, links, rtol=1e-7)


def test_a_coupled_cable_pulls_at_the_motor_it_comes_by() -> None:
    """The insertion's cable, which the second motor winds by 0.02 m a radian, takes so much of its load off there."""
    motors, links = at_rest(CableCoupling(3, 2, 0.02, home=1.2, of="gear"))
    np.testing.assert_allclose(motors, links - [0.0, 0.02 * links[2], 0.0], rtol=1e-7)
    motors, links = at_rest(CableCoupling(3, 2, 0.02, home=1.2))
    np.testing.assert_allclose(motors, links, rtol=1e-7)


@pytest.mark.parametrize(
    "gears",
    [
        (TransmissionRatio(2, 0.05, of="gear"),),
        (CableCoupling(3, 2, 0.02, of="gear"), CableCoupling(2, 1, -0.05, of="gear")),
        (
            TransmissionRatio(3, -0.03, of="gear"),
            CableCoupling(3, 1, 0.01, of="gear"),
            TransmissionRatio(1, 0.1, of="gear"),
        ),
    ],
)
def test_what_motors_put_in_links_take_up(gears: tuple[Effect, ...]) -> None:
    """For any small motion of the motors their work is the links': torques are by the transpose of how paths change."""
    outcome = run(raven(*gears, drive=drive("gravity")), hold(PLACE), passes=8)
    motors, links = at_rest(*gears)
    for moved in 1e-6 * np.eye(3):
        beside = run(raven(*gears, drive=drive("gravity")), hold(PLACE + moved), passes=8)
        by_motors = beside.motion.position[-1, 0] - outcome.motion.position[-1, 0]
        by_links = beside.q[-1, 0] - outcome.q[-1, 0]
        np.testing.assert_allclose(motors @ by_motors, links @ by_links, rtol=1e-5)


def test_a_live_arm_stands_with_the_torque_of_a_recorded_one() -> None:
    """What a gear takes off a motor, and what a coupled cable puts on another, is so for an arm that runs live."""
    machine = raven(TransmissionRatio(2, 0.1, of="gear"), CableCoupling(3, 2, 0.02, of="gear"), drive=drive("gravity"))
    live = LiveArm(machine, PLACE)
    stands = live.advance(np.tile(PLACE, (2000, 1)))
    np.testing.assert_allclose(stands.torque[-1, 0], at_rest(*machine.effects)[0], rtol=1e-5)
