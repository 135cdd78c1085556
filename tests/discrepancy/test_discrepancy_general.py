"""An effect that is a special case of another is not named with certainty where the data cannot tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import raven_swings
from scipy.stats import multivariate_normal

from gpcorrect.discrepancy import run as workflow
from gpcorrect.discrepancy.naming.intervals import half_widths, without_idle_numbers
from gpcorrect.discrepancy.naming.numbers import estimate_numbers
from gpcorrect.discrepancy.naming.occam import linear_evidence
from gpcorrect.discrepancy.naming.posterior import Named, name_effect
from gpcorrect.discrepancy.naming.weigh import own_gain
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import PreparedData, prepare_data
from gpcorrect.discrepancy.search.state import start_search, view_of
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import DhError, Effect, RegistrationError

MODEL = model_from_dict(
    {
        "arm": "raven2_left",
        "joints": [1, 2, 3],
        "log_rate_hz": 25,
        "noise": {"tracker_white": 2e-4},
        "T_tracker_base": {"translation": [0.1, -0.2, 0.3], "rotvec": [0.2, 0.1, -0.3]},
    }
)


def recorded(row: Effect, seed: int = 1) -> PreparedData:
    """Return ten motions of an arm with an effect of the arm or the base, as a tracker sees them."""
    recording = simulate(machine_of(MODEL).with_effects(row), raven_swings(seed, 10, 5.0), seed=seed)
    return prepare_data(replace(recording, external_jp=None), MODEL, np.random.default_rng(0))


def row_of(prepared: PreparedData, joint: int) -> Candidate:
    """Return the candidate of a row of the table."""
    rows = [c for c in all_candidates(prepared.dataset.scene) if (c.name, c.joint) == ("dh_error", joint)]
    return next(c for c in rows if ("form", "table") in c.fixed)


def named(size: float) -> Named:
    """Return what the first row of the table is called where it is off by `size` times half a millimetre and 2 mrad."""
    prepared = recorded(DhError(joint=1, a=5e-4 * size, alpha=2e-3 * size, d=-5e-4 * size, theta=2e-3 * size))
    wanted = [
        c for c in all_candidates(prepared.dataset.scene)
        if (c.name, c.joint) in {("dh_error", 1), ("registration_error", "base")}
    ]  # fmt: skip
    state = search(start_search(prepared.dataset, wanted), rounds=4)
    (fit,) = state.fitted
    assert fit.candidate.name == "dh_error"
    view = view_of(state, prepared)
    return name_effect(view, fit, own_gain(view, fit))[0]


@pytest.mark.parametrize(("size", "rivals"), [(0.16, {"registration_error"}), (1.0, set())])
def test_a_registration_is_ruled_out_only_by_what_would_show_it(size: float, rivals: set[str]) -> None:
    """A small error of the first row may be one of the registration; a large one would show its other numbers."""
    assert {r.name for r in named(size).rivals} == rivals


def test_what_these_sensors_do_not_see_stays_where_it_is_and_may_be_anything() -> None:
    """A turn about the last axis is the marker's own: rounding took it to an end of its range, and the name with it."""
    prepared = recorded(DhError(joint=3, a=0.0, alpha=-0.078, d=0.0, theta=0.0))
    row = row_of(prepared, 3)
    state = start_search(prepared.dataset, [row])
    (fit,) = refine(state.whitener, [], [FittedEffect(row, np.array(row.start))])
    alpha, theta = (next(i for i, c in enumerate(row.coordinates) if c.parameter.name == n) for n in ("alpha", "theta"))
    assert fit.at_edge == ()
    assert row.coordinates[alpha].value(float(fit.u[alpha])) == pytest.approx(-0.078, rel=0.03)
    widths = half_widths(replace(state, fitted=(fit,)), fit)
    assert widths[theta] == row.coordinates[theta].width
    assert widths[alpha] < 0.1 * row.coordinates[alpha].width


def test_numbers_that_the_data_do_not_ask_for_are_nothing() -> None:
    """Of a row of which one number is wrong the others are zero, not what noise makes of them; it is fitted anew."""
    prepared = recorded(DhError(joint=2, a=1e-3, alpha=0.0, d=0.0, theta=0.0))
    row = row_of(prepared, 2)
    state = start_search(prepared.dataset, [row])
    fitted = refine(state.whitener, [], [FittedEffect(row, np.array(row.start))])
    (lean,) = without_idle_numbers(replace(state, fitted=tuple(fitted)))
    numbers = dict(zip([c.parameter.name for c in row.coordinates], lean.u, strict=True))
    assert np.count_nonzero(fitted[0].u) == 4
    assert numbers["alpha"] == numbers["d"] == numbers["theta"] == 0.0
    assert row.coordinates[0].value(numbers["a"]) == pytest.approx(1e-3, rel=0.1)


def test_the_evidence_of_a_linear_model_is_what_is_left_of_the_data_once_its_numbers_are_integrated_out() -> None:
    """Bishop 2006, Eq. 3.81 beside 3.86: also where what a set leaves has a part that no tangent of it explains."""
    rng, noisier = np.random.default_rng(4), 1.7
    for numbers in (np.array([0.8]), np.array([0.5, -1.2, 0.3])):
        slopes = rng.normal(size=(40, len(numbers)))
        size = float(np.mean(numbers**2))
        basis = np.linalg.qr(slopes)[0]
        elsewhere = rng.normal(size=40)
        elsewhere -= basis @ (basis.T @ elsewhere)
        pull = slopes @ np.linalg.solve(slopes.T @ slopes, numbers) * noisier / size  # of the prior
        data = slopes @ numbers + pull + elsewhere
        misfit = 0.5 * float((data - slopes @ numbers) @ (data - slopes @ numbers))
        marginal = multivariate_normal(cov=noisier * np.eye(40) + size * slopes @ slopes.T).logpdf(data)
        alone = -0.5 * 40 * np.log(2.0 * np.pi * noisier)
        found = linear_evidence(slopes, numbers, slopes @ numbers, misfit, noisier)
        assert found + alone == pytest.approx(marginal, rel=1e-5)


def test_what_others_take_up_altogether_has_no_evidence() -> None:
    """A tracker whose axes are exchanged: a registration that takes up all that an effect changes ended the run."""
    assert linear_evidence(np.zeros((5, 2)), np.zeros(2), np.zeros(5), 3.0, 1.0) == -np.inf


def test_the_size_of_an_effect_is_whole_where_a_tolerance_takes_up_most_of_it() -> None:
    """Half a millimetre and mrad of the base, in a model that states it, were "below a quarter of the noise"."""
    hidden = RegistrationError("base", 5e-4, -3e-4, 3e-4, 4e-4, 0.0, -4e-4, 3e-4)
    prepared = recorded(hidden)
    dataset = prepared.dataset
    (base,) = (c for c in all_candidates(dataset.scene) if c.name == "registration_error")
    state = search(start_search(dataset, [base]), rounds=4)
    (fit,) = state.fitted
    view = view_of(state, prepared)
    called = name_effect(view, fit, own_gain(view, fit))[0]
    (found,) = workflow._effects_of(state, [called], estimate_numbers(state, state.fitted)).values()
    changes = [d.predict([fit.effect]) - d.predict() for d in (dataset, dataset.strict())]
    within, whole = (np.sqrt(np.mean(c**2, axis=0)).max() for c in changes)
    assert whole > 2.0 * within
    assert found.size == pytest.approx(whole / state.whitener.std.min(), rel=0.3)
