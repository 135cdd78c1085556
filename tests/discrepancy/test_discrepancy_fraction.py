"""What an effect must close of the gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log, motors
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.posterior import fraction_closed
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim.effects import HomingOffset
from gpcorrect.types import CalibrationLog


def _with_offset(log: CalibrationLog, offset: float) -> tuple[Search, FittedEffect]:
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    candidate = next(c for c in all_candidates(dataset.scene) if c.name == "homing_offset" and c.joint == 1)
    fit = FittedEffect(candidate, np.array([candidate.coordinates[0].coordinate(offset)]))
    state = start_search(dataset, [candidate])
    white = tuple(replace(n, white=NOISE, slow=0.0) for n in state.whitener.noises)
    return replace(state, fitted=(fit,), whitener=replace(state.whitener, noises=white)), fit


def test_the_right_effect_closes_the_gap_and_a_small_part_of_something_else_does_not() -> None:
    """An offset that is there closes all; a twentieth of a large step in its place leaves nearly all."""
    assert fraction_closed(*_with_offset(joint_log(2, HomingOffset(joint=1, offset=20 * NOISE)), 20 * NOISE)) == 1.0
    step = np.zeros((SAMPLES, RUNS, 2))
    step[..., 0] = 20 * NOISE * np.sign(motors(np.random.default_rng(2))[1][..., 0])
    assert fraction_closed(*_with_offset(joint_log(2, more=step), NOISE)) < SETTINGS.naming.least_closed
