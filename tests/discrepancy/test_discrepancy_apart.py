"""What is wrong in one channel changes nothing of what is found in another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import held_up_raven, swings_of

from gpcorrect.discrepancy.naming.numbers import Numbers, estimate_numbers
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.sim.effects import Backlash

RADIUS = 1e-3
FELL = 2.0  # rad


def numbers_beside(fell: float) -> Numbers:
    """Estimate the play of the second joint beside a first one whose motor is elsewhere by this, rad."""
    model = held_up_raven(2e-4, 2e-4, 3e-5)
    log = swings_of(model, Backlash(2, RADIUS))
    assert log.measured_jp is not None
    assert log.external_jp is not None
    moved = fell * np.column_stack([np.sin(0.7 * log.time), np.zeros((len(log), 2))])
    log = replace(log, measured_jp=log.measured_jp + moved, external_jp=log.external_jp + moved)
    dataset = prepare_data(log, model, np.random.default_rng(0)).dataset
    state = start_search(dataset, [c for c in all_candidates(dataset.scene) if (c.name, c.joint) == ("backlash", 2)])
    play = state.traces[0].candidate
    at = play.coordinates[0].coordinate(RADIUS)
    return estimate_numbers(state, [FittedEffect(play, np.array([at]))])


def test_a_motor_that_nothing_explains_says_nothing_of_a_play_behind_another() -> None:
    """Its load feels the play by a hundredth of its noise, and times ten thousand noise levels that was evidence.

    Beside an arm that fell a play of 2.5e-4 rad was reported as 3.3e-4, and 88 % of its gap as closed.
    """
    alone, beside = numbers_beside(0.0), numbers_beside(FELL)
    assert alone.fitted[0].u == pytest.approx(np.log(RADIUS / 1e-2), abs=0.02)
    assert beside.fitted[0].u == pytest.approx(alone.fitted[0].u, abs=1e-9)
