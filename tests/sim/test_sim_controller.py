"""Effects on the controller: what is missing in it, and what that costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect.errors import DataError
from gpcorrect.sim import Model, Plan, machine_of, model_from_dict, run
from gpcorrect.sim.effects.compliance import Payload
from gpcorrect.sim.effects.dynamics import (
    TERMS,
    BelievedPayload,
    FeedforwardError,
    GainError,
    InertiaError,
    IntegralAction,
    MotorConstantError,
)
from gpcorrect.sim.effects.geometry import TransmissionRatio
from gpcorrect.sim.effects.operators import play, plays
from gpcorrect.sim.effects.over_time import CommandDelay
from gpcorrect.sim.effects.reversal import Hysteresis
from gpcorrect.sim.plan import Segment, plan_of

KP = 400.0


def model(feedforward: str) -> Model:
    controller = {"kp": [KP, KP, 4000.0], "kd": [20.0, 20.0, 200.0], "feedforward": feedforward}
    return model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "controller": controller})


def plan() -> Plan:
    t = np.arange(300)[:, None] / 100.0
    path = np.array([0.3, 1.4, -0.38]) + np.array([0.3, 0.3, 0.03]) * np.sin(2 * t + np.array([0.0, 1.0, 2.0]))
    return plan_of([Segment(path, np.zeros(len(path), dtype=np.int64), 0, 0.0, 0.2)], 100.0)


def motors(feedforward: str, *effects: object) -> np.ndarray:
    return run(machine_of(model(feedforward)).with_effects(*effects), plan()).motion.position


def test_what_is_missing_is_what_another_model_has() -> None:
    """A controller that should feed gravity forward and lacks it is a controller that feeds nothing forward."""
    lacking = motors("gravity", *(FeedforwardError(j, -1.0, "gravity") for j in (1, 2, 3)))
    np.testing.assert_allclose(lacking, motors("none"), atol=1e-12)
    np.testing.assert_array_equal(motors("gravity", FeedforwardError("all", -1.0, "gravity")), lacking)
    whole = [FeedforwardError(j, 1.0, term) for j in (1, 2, 3) for term in ("gravity", "inertia")]
    np.testing.assert_allclose(motors("none", *whole), motors("rigid-body"), atol=1e-9)


def test_an_arm_held_up_where_its_motors_are_moves_as_without_gravity() -> None:
    """Gravity leaves nothing in a loop that holds the arm up where it is; it does where that is where it should be."""
    weightless = machine_of(model("none").model_copy(update={"gravity": (0.0, 0.0, 0.0)}))
    made = motors("gravity-measured")
    np.testing.assert_allclose(made, run(weightless, plan()).motion.position, atol=1e-9)
    assert np.abs(made - motors("gravity")).max() > 5e-6


def test_gains_of_the_effect_are_gains_of_the_controller() -> None:
    twice = replace(machine_of(model("gravity")).drive, kp=np.array([KP, 2 * KP, 4000.0]))
    other = replace(machine_of(model("gravity")), drive=twice)
    np.testing.assert_allclose(motors("gravity", GainError(2, 1.0)), run(other, plan()).motion.position, atol=1e-12)


def test_an_integral_that_the_model_states_is_the_one_that_the_effect_adds() -> None:
    nominal = model("none")
    assert nominal.controller is not None
    stated = nominal.controller.model_copy(update={"ki": (KP, KP, 4000.0)})
    other = run(machine_of(nominal.model_copy(update={"controller": stated})), plan()).motion.position
    np.testing.assert_allclose(motors("none", IntegralAction("all", 1.0)), other, atol=1e-12)
    assert np.abs(other - motors("none")).max() > 1e-4


def test_a_motor_of_less_torque_is_one_whose_whole_controller_asks_for_less() -> None:
    """Without feed-forward both gains are lower; with it, what holds and accelerates the arm is lower too."""
    weak = MotorConstantError(2, -0.2)
    np.testing.assert_allclose(motors("none", weak), motors("none", GainError(2, -0.2, -0.2)), atol=1e-12)
    parts = GainError(2, -0.2, -0.2), *(FeedforwardError(2, -0.2, term) for term in ("gravity", "inertia"))
    np.testing.assert_allclose(motors("rigid-body", weak), motors("rigid-body", *parts), atol=1e-12)
    # A term that is fed beyond the model is commanded as well; that of the velocity is a fraction of kd.
    more = [FeedforwardError(2, 0.5, term) for term in TERMS]
    parts = GainError(2, -0.2, -0.2), *map(FeedforwardError, (2, 2, 2), (0.8 * 1.5 - 1.0, 0.8 * 0.5, 0.5), TERMS)
    np.testing.assert_allclose(motors("gravity", *more, weak), motors("gravity", *parts), atol=1e-12)


def test_efforts_are_what_was_commanded_of_a_weak_motor() -> None:
    """It holds the same arm, so more is commanded of it."""
    nominal = machine_of(model("gravity"))
    still = plan_of([Segment(np.tile([0.3, 1.4, -0.38], (100, 1)), np.zeros(100, dtype=np.int64), 0, 0.0, 0.2)], 100.0)
    whole, weak = (run(m, still).torque[-1, 0, 1] for m in (nominal, nominal.with_effects(MotorConstantError(2, -0.2))))
    assert whole / weak == pytest.approx(0.8, rel=1e-3)


def test_a_motor_that_is_heavier_is_another_motor() -> None:
    """Without feed-forward it is a drive with that inertia; a controller that feeds inertia forward knows the old."""
    for feedforward, known in (("none", None), ("rigid-body", machine_of(model("none")).drive.motor_inertia)):
        nominal = machine_of(model(feedforward))
        heavier = nominal.drive.motor_inertia + np.array([0.0, 0.2, 0.0])
        other = replace(nominal, drive=replace(nominal.drive, motor_inertia=heavier, known_inertia=known))
        made = motors(feedforward, InertiaError(2, 0.2))
        np.testing.assert_allclose(made, run(other, plan()).motion.position, atol=1e-12)
        assert np.abs(made - motors(feedforward)).max() > 1e-4


@pytest.mark.parametrize("feedforward", ["none", "rigid-body"])
def test_motors_follow_a_late_command_late(feedforward: str) -> None:
    """From rest, a command that is four samples late is what was done four samples ago, whatever the controller."""
    t = np.clip(np.arange(200)[:, None] / 100.0 - 0.3, 0.0, 1.0)
    path = np.array([0.3, 1.4, -0.38]) + np.array([0.6, -0.5, 0.1]) * t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    moves = plan_of([Segment(path, np.zeros(len(path), dtype=np.int64), 0, 0.0, 0.2)], 100.0)
    machine = machine_of(model(feedforward))
    on_time, late = (run(m, moves).motion.position for m in (machine, machine.with_effects(CommandDelay("all", 0.04))))
    np.testing.assert_allclose(late[30:], on_time[26:-4], atol=2e-6)
    assert np.abs(late[30:] - on_time[30:]).max() > 0.02
    alone = run(machine.with_effects(CommandDelay(2, 0.04)), moves).motion.position
    np.testing.assert_allclose(alone[..., 1], late[..., 1], atol=2e-3)  # the others' inertia pulls at it
    np.testing.assert_allclose(alone[..., [0, 2]], on_time[..., [0, 2]], atol=2e-3)


@pytest.mark.parametrize("term", TERMS)
def test_a_term_acts_on_its_joint_alone(term: str) -> None:
    """Motors of the others move only by what the arm's dynamics carry over."""
    moved = np.abs(motors("gravity", FeedforwardError(2, 0.5, term)) - motors("gravity")).max(axis=(0, 1))
    assert moved[1] > 5 * max(moved[0], 10 * moved[2])


def test_a_ratio_holds_at_home() -> None:
    """Where the joint was homed nothing is off; a unit of motion later it is off by the error."""
    q = np.array([[[0.7, 0.0]], [[1.7, 0.0]]])
    made = machine_of(model("none"))
    motion = replace(run(made, plan()).motion, position=q, joints=(1, 2))
    true = TransmissionRatio(1, 0.1, home=0.7).act(q, motion)
    np.testing.assert_allclose(true[:, 0, 0], [0.7, 0.7 + 1.0 / 1.1])


def test_a_sum_of_one_play_is_a_play() -> None:
    """Plays of one width are that play, and a very sharp sum of plays tends to it."""
    path = np.cumsum(np.random.default_rng(0).standard_normal((400, 2)), axis=0)
    np.testing.assert_allclose(plays(path, np.full(3, 1.5)), play(path, 1.5), rtol=1e-14)
    motion = replace(run(machine_of(model("none")), plan()).motion, joints=(1,))
    sharp = Hysteresis(1, 1.5, 500.0, law="plays").act(path[..., None], motion)[..., 0]
    np.testing.assert_allclose(sharp, play(path, 1.5), atol=0.02)


@pytest.mark.parametrize("law", ["bouc_wen", "plays"])
def test_the_depth_of_a_hysteresis_is_what_a_reversal_loses(law: str) -> None:
    """Right after a reversal the joint goes 1 - depth of the way; after a long one it lags by the radius."""
    path = np.concatenate([np.linspace(0.0, 10.0, 1001), np.linspace(10.0, 0.0, 1001)[1:]])[:, None, None]
    motion = replace(run(machine_of(model("none")), plan()).motion, joints=(1,))
    q = Hysteresis(1, 0.4, 4.0, depth=0.25, law=law).act(path, motion)[:, 0, 0]
    assert q[1000] == pytest.approx(9.6, abs=2e-3)
    assert q[1000] - q[1002] == pytest.approx(0.75 * 0.02, abs=2e-4)
    assert q[-1] == pytest.approx(0.4, abs=2e-3)


@pytest.mark.parametrize(
    "bad", [lambda: FeedforwardError(1, 0.1, "friction"), lambda: Hysteresis(1, 1, 1, law="lugre")]
)
def test_what_is_no_member_is_refused(bad) -> None:
    with pytest.raises(DataError, match="must be"):
        bad()


def told(feedforward: str, mass: float) -> np.ndarray:
    """Motors of an arm that is said to carry so much more, which is taken off again: its controller alone knows it."""
    nominal = machine_of(model(feedforward))
    links = replace(nominal.body.links, payload=nominal.payload(plan()) + mass)
    known = replace(nominal, body=replace(nominal.body, links=links))
    unloaded = replace(plan(), payload=np.full(1, np.nan))
    return run(known.with_effects(Payload("all", -mass)), unloaded).motion.position


@pytest.mark.parametrize("feedforward", ["gravity", "gravity-measured", "rigid-body"])
def test_a_believed_payload_is_fed_forward_and_not_carried(feedforward: str) -> None:
    """It is the same as an arm that is said to carry it and does not."""
    made = motors(feedforward, BelievedPayload("all", 0.3))
    np.testing.assert_allclose(made, told(feedforward, 0.3), atol=2e-6)
    assert np.abs(made - motors(feedforward)).max() > 1e-3


def test_without_feed_forward_nobody_uses_what_is_believed() -> None:
    np.testing.assert_array_equal(motors("none", BelievedPayload("all", 0.3)), motors("none"))


def test_what_is_believed_and_carried_is_a_payload_that_the_model_knows() -> None:
    """At rest nothing is left of the two together."""
    both = motors("gravity", BelievedPayload("all", 0.3), Payload("all", 0.3))
    alone = motors("gravity", Payload("all", 0.3))
    assert np.abs(both - motors("gravity")).max() < 0.5 * np.abs(alone - motors("gravity")).max()
