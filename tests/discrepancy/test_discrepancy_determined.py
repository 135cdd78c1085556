"""What the data say of numbers: where a joint's zero lies has no part in it, nor that size and shape trade places."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discrepancy_core import NOISE, joint_log
from discrepancy_support import nominal

from gpcorrect.arms import arm_named
from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.discrepancy.naming import numbers
from gpcorrect.discrepancy.naming.intervals import half_widths, interval_ends, undetermined
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import Creep, Drift, HomingOffset, NonlinearStretch, PulleyEccentricity
from gpcorrect.sim.plan import Segment, plan_of
from gpcorrect.types import FloatArray

WAVES = 8.0


@pytest.mark.parametrize("zero", [0.0, 6.0, -20.0])
def test_a_wave_is_as_well_determined_wherever_the_joint_has_its_zero(zero: float) -> None:
    """One as large as the noise is, also where the phase is that of a place far outside the range."""
    log = joint_log(3, PulleyEccentricity(joint=1, amplitude=NOISE, waves=WAVES, phase=0.3))
    shift = np.array([zero, 0.0])
    log = replace(log, measured_jp=log.measured_jp + shift, external_jp=log.external_jp + shift)
    prepared = prepare_data(log, nominal(), np.random.default_rng(0))
    wheel = next(c for c in all_candidates(prepared.dataset.scene) if c.name == "pulley_eccentricity" and c.joint == 1)
    state = start_search(prepared.dataset, [wheel])
    phase = np.angle(np.exp(1j * (0.3 - WAVES * zero)))
    numbers = [c.coordinate(x) for c, x in zip(wheel.coordinates, (NOISE, WAVES, phase), strict=True)]
    (fit,) = refine(state.whitener, [], [FittedEffect(wheel, np.array(numbers))], 30)
    state = replace(state, fitted=(fit,))
    assert undetermined(state, fit) == []


def swing(rng: np.random.Generator) -> FloatArray:
    """Path `(500, 3)` of five seconds in which the first joints of a dVRK arm swing, each at its own speed."""
    time, limits = np.arange(0.0, 5.0, 0.01)[:, None], arm_named("dvrk_psm").limits[:3]
    rate, phase = rng.uniform(0.5, 2.0, 3), rng.uniform(0.0, 2 * np.pi, 3)
    middle: FloatArray = limits.mean(axis=1)
    return middle + 0.3 * np.ptp(limits, axis=1) * np.sin(rate * time + phase)


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
    rng = np.random.default_rng(1)
    segments = [Segment(swing(rng), np.zeros(500, dtype=np.int64), 0, 0.0, 0.2) for _ in range(10)]
    effect = NonlinearStretch(joint=2, stiffness=stiffness, cubic=cubic)
    log = simulate(machine_of(model).with_effects(effect), plan_of(segments, 100.0), seed=1)
    prepared = prepare_data(log, model, np.random.default_rng(0))
    wanted = [c for c in all_candidates(prepared.dataset.scene) if c.name == "nonlinear_stretch" and c.joint == 2]
    state = search(start_search(prepared.dataset, wanted), rounds=1)
    (fit,) = state.fitted
    half = half_widths(state, fit)[0]
    low, high = interval_ends(state, fit)[0]
    assert bool(half > fit.u[0]) is doubtful
    assert high == pytest.approx(fit.u[0] + half)
    assert low > 0.0 if doubtful else low == pytest.approx(fit.u[0] - half)
    assert low < fit.candidate.coordinates[0].coordinate(stiffness) < high


def test_an_encoder_that_is_late_alone_is_no_resonance() -> None:
    """To slow motion it is one whose damping may be anything: an effect whose numbers are open has no name."""
    noise = {"external_jp_white": [3e-4, 3e-4, 5e-5]}
    model = model_from_dict({"arm": "dvrk_psm", "joints": [1, 2, 3], "log_rate_hz": 50, "noise": noise})
    rng = np.random.default_rng(4)
    segments = [Segment(swing(rng), np.full(500, k), 0, 10.0 * k, 0.2) for k in range(10)]
    log = simulate(machine_of(model), plan_of(segments, 100.0), seed=1)
    seen = log.external_jp.copy()
    for k in range(10):
        rows = np.flatnonzero(log.trajectory == k)
        seen[rows, 1] = np.interp(log.time[rows] - 0.005, log.time[rows], seen[rows, 1])
    found = find_discrepancy(model, replace(log, external_jp=seen, tracker_cp=None))
    assert found.level == Level.UNKNOWN
    assert not [e for e in found.effects if e.joint == 2 and e.level == Level.EXACT]


def test_homings_of_which_a_tracker_knows_only_the_difference_are_not_nothing() -> None:
    """Their sum is a turn of the registration, so neither is known alone; rounding took that for both being nothing."""
    noise = {"tracker_white": 4e-4, "tracker_rotation_white": 4e-3}
    model = model_from_dict({"arm": "dvrk_psm", "joints": [1, 2, 3], "log_rate_hz": 25, "noise": noise})
    rng = np.random.default_rng(2)
    segments = [Segment(swing(rng), np.full(500, k), k % 2, 600.0 * (k // 2), 0.2) for k in range(12)]
    hidden = Drift(1, 1e-5), HomingOffset(1, (0.006, -0.004))
    log = replace(simulate(machine_of(model).with_effects(*hidden), plan_of(segments, 100.0), seed=1), external_jp=None)
    found = find_discrepancy(model, log)
    assert {(e.name, e.joint) for e in found.effects if e.level == Level.EXACT} == {("drift", 1), ("homing_offset", 1)}


@pytest.mark.parametrize(("names", "unsure"), [(("x", "y"), True), (("offset", "offset"), False), (("mass",), True)])
def test_what_has_no_number_that_is_clear_of_nothing_has_no_name(names, unsure, monkeypatch) -> None:
    """A link's centre of mass, along an axis along which its neighbour's does the same, was EXACT; homings are."""
    monkeypatch.setattr(numbers, "away_from_nothing", lambda state, fit: True)
    several = tuple(SimpleNamespace(identity=0.0, parameter=SimpleNamespace(name=name)) for name in names)
    fit: Any = SimpleNamespace(candidate=SimpleNamespace(sizes=range(len(names)), coordinates=several))
    state: Any = None
    assert numbers._may_be_nothing(state, fit, dict.fromkeys(range(len(names)), (-1.0, 2.0))) is unsure
    assert not numbers._may_be_nothing(state, fit, dict.fromkeys(range(len(names)), (0.5, 2.0)))


def test_a_place_is_at_the_edge_by_the_range_it_may_take_not_by_how_far_it_is_from_zero() -> None:
    """A stop a twentieth of its range from the end of it has a place, on a joint that moves far from zero too."""
    log, far = joint_log(3), np.array([4.0, 0.0])
    log = replace(log, measured_jp=log.measured_jp + far, external_jp=log.external_jp + far)
    scene = prepare_data(log, nominal(), np.random.default_rng(0)).dataset.scene
    lower = (("end", "lower"),)
    stop = next(c for c in all_candidates(scene) if (c.name, c.joint, c.fixed) == ("joint_stop", 1, lower))
    low, high = stop.coordinates[1].bounds
    for part, at_edge in ((0.05, ()), (0.005, ("limit",)), (0.995, ("limit",))):
        assert FittedEffect(stop, np.array([1.0, low + part * (high - low)])).at_edge == at_edge


@pytest.mark.parametrize("beyond", [-1e-3, 0.0, 1e3])
def test_a_number_that_is_held_is_held_inside_its_range(beyond: float) -> None:
    """A resonance that is none has no frequency: the end of its interval was sought below all frequencies."""
    scene = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset.scene
    candidate = next(c for c in all_candidates(scene) if c.name == "resonance")
    (size, *_), fit = candidate.sizes, FittedEffect(candidate, np.array(candidate.start))
    low, high = candidate.coordinates[size].bounds
    held = fit.pinned(size, beyond).candidate.coordinates[size]
    assert low <= held.bounds[0] < held.bounds[1] <= high
    assert held.bounds[1] - held.bounds[0] < 1e-3 * (high - low)


def brought_to_speed(seed: int, runs: int, seconds: float = 4.0) -> list[Segment]:
    """Motions in two sessions in which a RAVEN-II's first joints swing, each beginning at rest."""
    rng = np.random.default_rng(seed)
    t, middle, reach = np.arange(0.0, seconds, 0.01)[:, None], np.array([0.3, 1.4, -0.38]), np.array([0.7, 0.6, 0.05])
    segments = []
    for run in range(runs):
        rate, phase = rng.uniform(0.5, 2.0, 3), rng.uniform(0.0, 2 * np.pi, 3)
        path = middle + reach * np.sin(rate * (t - 0.8 * np.tanh(t / 0.8)) + phase)
        segments.append(Segment(path, np.full(len(path), run), 2 * run // runs, 2.0 * seconds * run, 0.2))
    return segments


@pytest.mark.parametrize("balance", [1.0, 0.0])
def test_a_creep_is_itself_whether_its_sessions_begin_settled_or_relaxed(balance: float) -> None:
    """One that began relaxed was a drift with a time constant, EXACT: nothing else in the catalogue fades in so."""
    noise = {"external_jp_white": [3e-4, 3e-4, 5e-5]}
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 25, "noise": noise})
    hidden = Creep(1, 3e-3, 15.0, balance=balance)
    log = simulate(machine_of(model).with_effects(hidden), plan_of(brought_to_speed(5, 12), 100.0), seed=7)
    found = find_discrepancy(model, replace(log, tracker_cp=None))
    assert found.level == Level.EXACT
    (effect,) = found.effects
    assert (effect.name, effect.joint) == ("creep", 1)
    assert effect.parameters["compliance"].value == pytest.approx(3e-3, rel=0.05)
    if balance == 0.0:
        low, high = effect.parameters["balance"].ci95
        assert low < balance < high


def test_what_begins_anew_with_each_motion_is_no_coupling_that_drags() -> None:
    """A ramp in each motion was named one, whose drag took its coefficient back and turned round over any radius."""
    noise = {"external_jp_white": [3e-4, 3e-4, 5e-5]}
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 25, "noise": noise})
    log = simulate(machine_of(model), plan_of(brought_to_speed(11, 12, 6.0), 100.0), seed=11)
    begins = np.array([log.time[log.trajectory == k][0] for k in range(12)])
    seen = log.external_jp.copy()
    seen[:, 1] += 1.3e-4 * (log.time - begins[log.trajectory])
    found = find_discrepancy(model, replace(log, external_jp=seen, tracker_cp=None))
    assert not [e for e in found.effects if e.joint == 2]
