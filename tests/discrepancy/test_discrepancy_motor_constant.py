"""What a controller asks for and the motor does not deliver, and what it was told of and the arm does not carry."""

from __future__ import annotations

import pytest
from discrepancy_core import held_up_raven, swings_of

from gpcorrect.discrepancy import DiscrepancyResult, find_discrepancy
from gpcorrect.sim import Model
from gpcorrect.sim.effects import Effect
from gpcorrect.sim.effects.dynamics import BelievedPayload, FeedforwardError, GainError, MotorConstantError


def raven() -> Model:
    """Return an arm whose controller holds it up, with encoders outside, logged at 50 Hz: swings need no more."""
    return held_up_raven(5e-5, 5e-5, 1e-5, rate_hz=50.0)


def found(*hidden: Effect) -> DiscrepancyResult:
    """Return the verdict on swings of the arm."""
    model = raven()
    return find_discrepancy(model, swings_of(model, *hidden))


@pytest.mark.slow
def test_a_weak_motor_is_no_controller_that_feeds_less_forward() -> None:
    """It was one, EXACT, by 1 / 0.85 - 1: where a motor hardly accelerates the two are the same."""
    (effect,) = found(MotorConstantError(2, -0.15)).effects
    assert (effect.name, effect.joint) == ("motor_constant_error", 2)
    assert effect.parameters["fraction"].value == pytest.approx(-0.15, rel=0.05)


@pytest.mark.slow
def test_a_controller_that_feeds_less_forward_is_no_weak_motor() -> None:
    """The other way round."""
    (effect,) = found(FeedforwardError(2, -0.2)).effects
    assert (effect.name, effect.joint) == ("feedforward_error", 2)
    assert effect.parameters["fraction"].value == pytest.approx(-0.2, rel=0.05)


@pytest.mark.slow
def test_a_payload_that_the_controller_alone_believes_is_named() -> None:
    """Eight effects of links and gains had stood in for it; a model that has it has no other discrepancy."""
    model = raven()
    hidden = BelievedPayload("all", 0.2)
    log = swings_of(model, hidden)
    (effect,) = find_discrepancy(model, log).effects
    assert effect.name == "believed_payload"
    assert effect.parameters["mass"].value == pytest.approx(0.2, rel=0.1)
    completed = model.model_copy(update={"effects": (hidden,)})
    assert not find_discrepancy(completed, log).effects


@pytest.mark.slow
@pytest.mark.parametrize("joint", [2, "all"])
def test_where_nothing_is_fed_forward_a_weak_motor_is_both_gains_by_one_fraction(joint: int | str) -> None:
    """One law: no recording tells the two apart, and neither is EXACT; the advice says that none will."""
    fed = raven()
    assert fed.controller is not None
    model = fed.model_copy(update={"controller": fed.controller.model_copy(update={"feedforward": "none"})})
    result = find_discrepancy(model, swings_of(model, MotorConstantError(joint, -0.15)))
    (effect,) = result.effects
    (rival,) = effect.rivals
    assert {effect.name, rival.name} == {"motor_constant_error", "gain_error"}
    assert effect.joint == rival.joint == joint
    assert (effect.level, effect.probability) == ("CLASS", pytest.approx(rival.probability))
    assert result.next_experiment is not None
    assert not result.next_experiment.decisive


@pytest.mark.slow
def test_gains_off_by_fractions_of_their_own_in_all_joints_are_one_effect() -> None:
    """It was a motor constant of all, EXACT, with a gain of some joints beside it."""
    (effect,) = found(GainError("all", proportional=0.05, derivative=-0.1)).effects
    assert (effect.level, effect.name, effect.joint) == ("EXACT", "gain_error", "all")
    assert effect.parameters["proportional"].value == pytest.approx(0.05, rel=0.1)
    assert effect.parameters["derivative"].value == pytest.approx(-0.1, rel=0.2)
