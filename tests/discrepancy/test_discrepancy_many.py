"""Sets of more effects in one channel than are estimated together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.intervals import size_overdispersion
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.sim.effects import HomingOffset


@pytest.fixture(scope="module")
def crowded() -> Search:
    """Return a search that found everything that leaves a trace at the first joint."""
    log = joint_log(1, HomingOffset(1, 0.01), sessions=4)
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    shapes: dict[tuple[object, ...], Candidate] = {}
    for candidate in all_candidates(dataset.scene):
        if candidate.joint == 1:
            shapes.setdefault(candidate.key, candidate)
    state = start_search(dataset, shapes.values())
    found = replace(state, fitted=tuple(FittedEffect(t.candidate, np.array(t.candidate.start)) for t in state.traces))
    assert len(found.fitted) > SEARCH.free_together + 1
    return found


def test_an_effect_is_estimated_with_the_latest_of_its_channel(crowded: Search) -> None:
    """However many others show there, the effect that is asked about is among those whose numbers are free."""
    for fit in crowded.fitted:
        fixed, free = crowded.parted(crowded.fitted, fit.candidate)
        assert fit in free
        assert len(free) == SEARCH.free_together
        assert {*fixed, *free} == {*crowded.fitted}
        others = [m for m in crowded.fitted if m is not fit]
        assert [m for m in free if m is not fit] == others[1 - SEARCH.free_together :]


def test_every_effect_of_a_crowded_channel_is_weighed(crowded: Search) -> None:
    """The first of twelve has a size in every trajectory, as the last has."""
    for fit in crowded.fitted:
        assert size_overdispersion(crowded, fit) >= 1.0


def test_a_fit_that_looks_at_its_own_channels_alone_is_that_of_all() -> None:
    """The other joint's residual is a constant: the same numbers, and as hopeless beside the same misfit."""
    log = joint_log(1, HomingOffset(1, 0.01), HomingOffset(2, 0.02))
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    state = start_search(dataset, [c for c in all_candidates(dataset.scene) if c.name == "backlash"])
    first, second = (next(t.candidate for t in state.traces if t.candidate.joint == joint) for joint in (1, 2))
    fit = FittedEffect(first, np.array(first.start))
    assert [*state.shown([first])] == [True, False]
    assert state.shown([first, second]).all()
    (alone,), (whole,) = state.refit([fit], fit.candidate), refine(state.whitener, [], [fit])
    assert alone.u == pytest.approx(whole.u, rel=1e-3)
    for worth in (0.9 * state.misfit([whole]), state.misfit([whole])):
        (alone,) = state.refit([fit], fit.candidate, worth)
        (whole,) = refine(state.whitener, [], [fit], worth=worth)
        assert alone.u == pytest.approx(whole.u, rel=1e-3)
