"""Gears as stiff as those of heavy arms, seen by sensors that are good enough."""

from __future__ import annotations

import pytest
from discrepancy_core import held_up_raven, swings_of

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.sim.effects import CableStretch


@pytest.mark.slow
def test_a_stiff_gear_is_no_creep() -> None:
    """Above 1e5 N m/rad no stretch was physical, and creep, whose compliance goes down to nothing, stood in for it."""
    model = held_up_raven(2e-8, 2e-8, 2e-8)
    effects = find_discrepancy(model, swings_of(model, CableStretch(1, 1e6))).effects
    assert [(e.name, e.joint) for e in effects] == [("cable_stretch", 1)]
    assert effects[0].parameters["stiffness"].value == pytest.approx(1e6, rel=0.05)
