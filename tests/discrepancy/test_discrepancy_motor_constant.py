"""A motor that delivers less torque than was commanded: gains and what is fed forward are lower by one fraction."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy_core import raven_swings

from gpcorrect.discrepancy import DiscrepancyResult, find_discrepancy
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import Effect
from gpcorrect.sim.effects.dynamics import FeedforwardError, MotorConstantError


def found(*hidden: Effect) -> DiscrepancyResult:
    """Return the verdict on swings of an arm whose controller holds it up, with encoders outside."""
    model = model_from_dict(
        {
            "arm": "raven2_left",
            "joints": [1, 2, 3],
            "log_rate_hz": 100,
            "controller": {"kp": [200.0, 200.0, 3000.0], "kd": [10.0, 10.0, 150.0], "feedforward": "gravity"},
            "noise": {"external_jp_white": [5e-5, 5e-5, 1e-5]},
        }
    )
    log = simulate(machine_of(model).with_effects(*hidden), raven_swings(5, 8, 4.0), seed=7)
    return find_discrepancy(model, replace(log, tracker_cp=None))


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
