"""A shape is named only where the data determine its numbers, and where a joint's zero lies has no part in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import NOISE, joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.intervals import undetermined
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.sim.effects import PulleyEccentricity

WAVES = 8.0


@pytest.mark.parametrize("zero", [0.0, 6.0, -20.0])
def test_a_wave_is_as_well_determined_wherever_the_joint_has_its_zero(zero: float) -> None:
    """One as large as the noise is, also where the phase is that of a place far outside the range."""
    log = joint_log(3, PulleyEccentricity(joint=1, amplitude=NOISE, waves=WAVES, phase=0.3))
    shift = np.array([zero, 0.0])
    assert log.measured_jp is not None
    assert log.external_jp is not None
    log = replace(log, measured_jp=log.measured_jp + shift, external_jp=log.external_jp + shift)
    prepared = prepare_data(log, nominal(), np.random.default_rng(0))
    wheel = next(c for c in all_candidates(prepared.dataset.scene) if c.name == "pulley_eccentricity" and c.joint == 1)
    state = start_search(prepared.dataset, [wheel])
    phase = np.angle(np.exp(1j * (0.3 - WAVES * zero)))
    numbers = [c.coordinate(x) for c, x in zip(wheel.coordinates, (NOISE, WAVES, phase), strict=True)]
    (fit,) = refine(state.whitener, [], [FittedEffect(wheel, np.array(numbers))], 30)
    state = replace(state, fitted=(fit,))
    assert undetermined(state, state.whitener, [fit], fit) == []
