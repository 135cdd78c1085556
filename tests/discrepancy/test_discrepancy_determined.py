"""What the data say of numbers: where a joint's zero lies has no part in it, nor that size and shape trade places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import NOISE, joint_log
from discrepancy_support import nominal

from gpcorrect.arms import arm_named
from gpcorrect.discrepancy.naming.intervals import half_widths, interval_ends, undetermined
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import NonlinearStretch, PulleyEccentricity
from gpcorrect.sim.plan import Segment, plan_of

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


@pytest.mark.parametrize(("stiffness", "cubic", "doubtful"), [(226.0, 6.7e8, True), (500.0, 6.7e9, False)])
def test_a_stretch_that_is_beyond_doubt_has_no_interval_that_holds_nothing(
    stiffness: float, cubic: float, doubtful: bool
) -> None:
    """Stiffness and hardening trade places: a straight line goes through no stretch, which thousands of nats rule out.

    The profile's end does not, and the true number stays inside; elsewhere the line's ends stand.
    """
    model = model_from_dict(
        {"arm": "dvrk_psm", "joints": [1, 2, 3], "log_rate_hz": 25, "noise": {"external_jp_white": [3e-4, 3e-4, 5e-5]}}
    )
    rng, t, limits = np.random.default_rng(1), np.arange(0.0, 5.0, 0.01)[:, None], arm_named("dvrk_psm").limits[:3]
    segments = []
    for _ in range(10):
        rate, phase = rng.uniform(0.5, 2.0, 3), rng.uniform(0.0, 2 * np.pi, 3)
        path = limits.mean(axis=1) + 0.3 * np.ptp(limits, axis=1) * np.sin(rate * t + phase)
        segments.append(Segment(path, np.zeros(len(path), dtype=np.int64), 0, 0.0, 0.2))
    effect = NonlinearStretch(joint=2, stiffness=stiffness, cubic=cubic)
    log = simulate(machine_of(model).with_effects(effect), plan_of(segments, 100.0), seed=1)
    prepared = prepare_data(log, model, np.random.default_rng(0))
    wanted = [c for c in all_candidates(prepared.dataset.scene) if c.name == "nonlinear_stretch" and c.joint == 2]
    state = search(start_search(prepared.dataset, wanted), rounds=1)
    (fit,) = state.fitted
    half = half_widths(state, state.whitener, [fit], fit)[0]
    low, high = interval_ends(state, state.whitener, [fit], fit)[0]
    assert bool(half > fit.u[0]) is doubtful
    assert high == pytest.approx(fit.u[0] + half)
    assert low > 0.0 if doubtful else low == pytest.approx(fit.u[0] - half)
    assert low < fit.candidate.coordinates[0].coordinate(stiffness) < high
