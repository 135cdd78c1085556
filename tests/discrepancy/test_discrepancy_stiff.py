"""Gears as stiff as those of heavy arms, seen by sensors that are good enough."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy_core import raven_swings

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import CableStretch


@pytest.mark.slow
def test_a_stiff_gear_is_no_creep() -> None:
    """Above 1e5 N m/rad no stretch was physical, and creep, whose compliance goes down to nothing, stood in for it."""
    model = model_from_dict(
        {
            "arm": "raven2_left",
            "joints": [1, 2, 3],
            "log_rate_hz": 100,
            "controller": {"kp": [200.0, 200.0, 3000.0], "kd": [10.0, 10.0, 150.0], "feedforward": "gravity"},
            "noise": {"external_jp_white": [2e-8, 2e-8, 2e-8]},
        }
    )
    log = simulate(machine_of(model).with_effects(CableStretch(1, 1e6)), raven_swings(5, 8, 4.0), seed=7)
    effects = find_discrepancy(model, replace(log, tracker_cp=None)).effects
    assert [(e.name, e.joint) for e in effects] == [("cable_stretch", 1)]
    assert effects[0].parameters["stiffness"].value == pytest.approx(1e6, rel=0.05)
