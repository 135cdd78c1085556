"""A wave that is but the first of several is no wheel off its centre."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log, motors
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.posterior import overtone_nats
from gpcorrect.discrepancy.naming.view import view_of
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim.effects import HomingOffset, PulleyEccentricity
from gpcorrect.types import CalibrationLog

SEED, WAVES, SIZE = 2, 6.0, 10 * NOISE


def gains(log: CalibrationLog) -> tuple[float, float]:
    """Nats of the fitted first wave (its own energy over two), and of its overtones."""
    prepared = prepare_data(log, nominal(), np.random.default_rng(0))
    candidate = next(
        c for c in all_candidates(prepared.dataset.scene) if c.name == "pulley_eccentricity" and c.joint == 1
    )
    state = start_search(prepared.dataset, [candidate])
    near = candidate.coordinates[0].coordinate(SIZE), candidate.coordinates[1].coordinate(WAVES), 0.3
    (fit,) = refine(state.whitener, [], [FittedEffect(candidate, np.array(near))], 30)
    state = replace(state, fitted=(fit,)).refreshed()
    view = view_of(state, prepared)
    change = state.whitener.whiten(state.residual([]) - state.residual([fit]))
    return 0.5 * float(change @ change), overtone_nats(view, fit)


def wave(more: float) -> CalibrationLog:
    path = motors(np.random.default_rng(SEED))[1]
    added = np.zeros((SAMPLES, RUNS, 2))
    added[..., 0] = more * SIZE * np.sin(2 * WAVES * path[..., 0] + 1.0)
    return joint_log(SEED, PulleyEccentricity(joint=1, amplitude=SIZE, waves=WAVES, phase=0.3), more=added)


def test_a_wheel_off_its_centre_has_no_overtones() -> None:
    own, others = gains(wave(0.0))
    assert own > 100.0
    assert others < 5.0


def test_a_periodic_error_of_another_kind_has() -> None:
    own, others = gains(wave(0.9))
    assert others > SETTINGS.naming.most_overtones * own


def test_effects_that_are_not_periodic_have_none_to_look_for() -> None:
    assert HomingOffset(joint=1, offset=0.1).overtones() == ()
    overtones = PulleyEccentricity(joint=1, amplitude=0.1, waves=3.0, phase=0.0).overtones()
    assert {o.waves for o in overtones} == {6.0, 9.0, 12.0}
