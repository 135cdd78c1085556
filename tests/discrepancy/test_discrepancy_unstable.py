"""Machines whose servo is near the edge of stability, beyond which some of what is tried is no machine."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy_core import raven_swings

from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import JointStop

MODEL = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "log_rate_hz": 100,
    "controller": {"kp": [356.0, 288.0, 40_000.0], "kd": [20.0, 17.6, 1300.0], "feedforward": "gravity"},
    "transmission": {"motor_inertia": [0.35, 0.3, 0.36]},
}


def test_a_rival_that_makes_the_servo_unstable_does_not_end_the_run() -> None:
    """A stop is named beside an error of the inertia, which at the size that it would need has no stable loop."""
    plan, model = raven_swings(5, 8, 4.0), model_from_dict(MODEL)
    low, high = plan.q[..., 2].min(), plan.q[..., 2].max()
    stop = JointStop(3, 4400.0, low + 0.15 * (high - low), "lower")
    log = simulate(machine_of(model).with_effects(stop), plan, seed=7)
    found = find_discrepancy(model, replace(log, tracker_cp=None), seed=0)
    assert found.level == Level.EXACT
    (effect,) = found.effects
    assert (effect.name, effect.joint) == ("joint_stop", 3)
    assert effect.parameters["stiffness"].value == pytest.approx(4400.0, rel=0.05)
