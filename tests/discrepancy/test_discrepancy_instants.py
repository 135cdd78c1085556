"""Change-points: found wherever they are, and not where noise is slow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import NOISE, RUNS, SAMPLES, held_up_raven, joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.evidence.whitener import whitener_on
from gpcorrect.discrepancy.naming.intervals import half_widths, size_overdispersion
from gpcorrect.discrepancy.outcome.sentences import verdict_sentences
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates, watched
from gpcorrect.discrepancy.search.instants import with_open_instant_placed
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.sim import machine_of, simulate
from gpcorrect.sim.effects import CableSlip, HomingOffset
from gpcorrect.sim.plan import Segment, plan_of
from gpcorrect.types import CalibrationLog

INSTANT = 5 * 60.0 - 15.0  # in the pause before the sixth motion, between the ladder's rungs
SEEN = (3 * 60.0 + 8.0, 6 * 60.0)  # the discovery motions around it


@pytest.fixture(scope="module")
def slipped() -> tuple[Search, FittedEffect]:
    """Return a search on a recording with a slip, and the slip refined from the nearest rung."""
    log = joint_log(3, CableSlip(joint=1, step=4 * NOISE, instant=INSTANT))
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    state = start_search(dataset, (c for c in all_candidates(dataset.scene) if c.name == "cable_slip" and c.joint == 1))
    start = min((t.candidate for t in state.traces), key=lambda c: abs(c.build(np.array(c.start)).instant - INSTANT))
    (found,) = refine(state.whitener, [], [FittedEffect(start, np.array(start.start))])
    return state, found


def test_a_slip_is_found_between_the_rungs(slipped: tuple[Search, FittedEffect]) -> None:
    """Between the right motions, as exactly as the recording can tell; step within a tenth."""
    effect = slipped[1].effect
    assert isinstance(effect, CableSlip)
    assert SEEN[0] < effect.instant < SEEN[1]
    assert effect.step == pytest.approx(4 * NOISE, rel=0.1)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_slip_in_the_middle_of_a_motion_is_found_there(seed: int) -> None:
    """Not in the pause before it, wherever the search began: the jump itself tells, and shows in one row."""
    instant = 9 * 60.0 + 4.3  # of the discovery part
    log = joint_log(seed, CableSlip(joint=2, step=6 * NOISE, instant=instant))
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    state = start_search(dataset, (c for c in all_candidates(dataset.scene) if c.name == "cable_slip" and c.joint == 2))
    assert dataset.part[np.searchsorted(dataset.time, instant)] == 0
    for trace in state.traces[:: len(state.traces) // 4]:
        start = FittedEffect(trace.candidate, np.array(trace.candidate.start))
        (found,) = refine(state.whitener, [], [start])
        assert isinstance(found.effect, CableSlip)
        assert found.effect.instant == pytest.approx(instant, abs=0.5)


def test_a_slip_takes_two_motions_after_it() -> None:
    """The instants that are looked at begin a second into the session, and leave out its last two motions."""
    scene = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset.scene
    low, high = watched(scene, 0)
    assert low == pytest.approx(1.0, abs=0.1)
    assert high == pytest.approx((RUNS - 2) * 60.0)
    assert watched(scene, 1) == (np.inf, -np.inf)


def test_a_slip_in_the_first_motion_of_a_session_is_placed_by_that_session_alone() -> None:
    """Its trace shows in the other session too, through the registration of the tracker: that one's clock says nothing.

    A slip 4 s into the second session was called a homing offset of it.
    """
    model, rng = held_up_raven(1e-5, 1e-5, 1e-6), np.random.default_rng(5)
    slip, t = CableSlip(joint=1, step=5e-3, instant=2.0, session=1), np.arange(0.0, 4.0, 0.01)[:, None]
    middle, swing, rates = np.array([0.3, 1.4, -0.38]), np.array([0.7, 0.6, 0.05]), rng.uniform(0.5, 2.0, (12, 3))
    paths = [middle + swing * np.sin(rate * t) for rate in rates]
    segments = [Segment(q, np.full(len(q), i), i // 6, 20.0 * (i % 6)) for i, q in enumerate(paths)]
    log = simulate(machine_of(model).with_effects(slip), plan_of(segments, 100.0), seed=7)
    parts = (prepare_data(log, model, np.random.default_rng(k)).dataset for k in range(9))
    dataset = next(d for d in parts if not d.discovery[d.trajectory == 6].any())
    state = start_search(dataset, (c for c in all_candidates(dataset.scene) if c.name == "cable_slip" and c.joint == 1))
    start = next(t.candidate for t in state.traces if t.candidate.fixed == (("session", 1),))
    (found,) = refine(state.whitener, [], [FittedEffect(start, np.array(start.start))])
    unseen = whitener_on(dataset, state.residual([found]), ~dataset.discovery)
    placed, _ = with_open_instant_placed(unseen, [], found, dataset.discovery)
    assert isinstance(placed.effect, CableSlip)
    assert placed.effect.instant == pytest.approx(2.0, abs=0.1)


def test_what_only_the_test_set_shows_is_no_exact_name() -> None:
    """A slip in the first motion, which nothing is fitted to, is an offset elsewhere: UNKNOWN, and it says why."""
    log = joint_log(3, CableSlip(joint=1, step=8 * NOISE, instant=4.0))
    seed = next(k for k in range(99) if _first_motion_is_tested(log, k))
    found = find_discrepancy(nominal(), log, seed=seed)
    assert [e.name for e in found.effects] == ["homing_offset"]
    assert found.level == "UNKNOWN"
    assert "motions of the test set alone" in verdict_sentences(found)[0]


def test_motions_that_start_anew_follow_each_other() -> None:
    """Each motion with a clock of its own: the slip is found all the same, and a remark says what was taken."""
    log = joint_log(6, CableSlip(joint=1, step=6 * NOISE, instant=7 * 60.0 - 20.0))
    begin = np.array([log.time[log.trajectory == k].min() for k in range(RUNS)])
    found = find_discrepancy(nominal(), replace(log, time=log.time - begin[log.trajectory]))
    assert [(e.name, e.level) for e in found.effects] == [("cable_slip", "EXACT")]
    assert any("start anew" in remark for remark in found.provenance.remarks)


def test_a_motion_that_another_interrupts_does_not_start_anew() -> None:
    """Numbers that come again are no clock that does."""
    log = joint_log(6)
    torn = np.where(log.trajectory == 2, 0, log.trajectory)
    prepared = prepare_data(replace(log, trajectory=torn), nominal(), np.random.default_rng(0))
    np.testing.assert_array_equal(prepared.log.time, log.time)


def test_an_effect_is_asked_to_help_only_where_it_acts() -> None:
    """A slip late in a session leaves half of the motions alone, and is named all the same."""
    found = find_discrepancy(nominal(), joint_log(6, CableSlip(joint=1, step=6 * NOISE, instant=7 * 60.0 - 20.0)))
    assert [(e.name, e.level) for e in found.effects] == [("cable_slip", "EXACT")]


@pytest.mark.parametrize("part", ["confirmation", "test"])
@pytest.mark.parametrize("beside", [-20.0, 3.0, 20.0])
def test_a_slip_beside_a_motion_that_the_search_never_saw_is_on_its_right_side(part: str, beside: float) -> None:
    """Discovery leaves open on which side of another part's motion it was: that motion shows it, and it has a name."""
    dataset = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset
    begins = 60.0 * next(k for k in range(3, RUNS) if getattr(dataset, part)[dataset.trajectory == k].all())
    log = joint_log(3, CableSlip(joint=1, step=6 * NOISE, instant=begins + beside))
    found = find_discrepancy(nominal(), log, seed=0)
    assert [(e.name, e.level) for e in found.effects] == [("cable_slip", "EXACT")]
    assert found.level == "EXACT"
    low, high = found.effects[0].parameters["instant"].ci95
    assert low < begins + beside < high


def test_an_instant_is_chosen_among_the_rows_between_two_known_ones(
    slipped: tuple[Search, FittedEffect],
) -> None:
    """So many are paid for: those of the motions that discovery has not seen, and one where every row is known."""
    state, found = slipped
    dataset = state.dataset
    unseen = whitener_on(dataset, state.residual([found]), ~dataset.discovery)
    between = np.count_nonzero((dataset.time > SEEN[0]) & (dataset.time < SEEN[1] + 0.1))
    _, chosen = with_open_instant_placed(unseen, [], found, dataset.discovery)
    assert chosen == pytest.approx(between, abs=2)
    assert chosen > 100
    same, one = with_open_instant_placed(unseen, [], found, np.ones(len(dataset), dtype=np.bool_))
    assert one == 1
    assert same is found


def test_the_interval_of_an_instant_holds_it_and_is_no_point(slipped: tuple[Search, FittedEffect]) -> None:
    """No slope leads to an instant, and yet its interval is neither empty nor the whole session."""
    state, found = slipped
    place = next(i for i, c in enumerate(found.candidate.coordinates) if c.parameter.change_point)
    coordinate, width = found.candidate.coordinates[place], half_widths(replace(state, fitted=(found,)), found)[place]
    low, high = (coordinate.value(float(found.u[place]) + side * width) for side in (-1, 1))
    assert low < INSTANT < high
    assert high - low < 4 * 60.0  # of the motions on either side, one is not of the discovery part


def test_zeros_that_differ_at_random_from_motion_to_motion_are_no_slip() -> None:
    """Every motion has an offset of its own, as slow noise gives it: nothing on time gets an exact name."""
    found = find_discrepancy(nominal(), _offsets_of_their_own())
    exact = {e.name for e in found.effects if e.level == "EXACT"}
    assert not exact & {"cable_slip", "drift", "creep", "homing_offset"}


def test_evidence_counts_less_where_a_size_differs_from_motion_to_motion() -> None:
    """An offset that every motion has anew is worth less than its samples say; one that all fraction is worth them."""
    shared = joint_log(4, HomingOffset(joint=1, offset=1.5 * NOISE))
    assert _overdispersion_of_offset(shared) == 1.0
    assert _overdispersion_of_offset(_offsets_of_their_own()) > 3.0


def _first_motion_is_tested(log: CalibrationLog, seed: int) -> bool:
    dataset = prepare_data(log, nominal(), np.random.default_rng(seed)).dataset
    return bool(dataset.test[dataset.trajectory == 0].all())


def _offsets_of_their_own() -> CalibrationLog:
    zeros = 1.5 * NOISE * np.random.default_rng(8).standard_normal((1, RUNS, 2))
    return joint_log(4, more=np.broadcast_to(zeros, (SAMPLES, RUNS, 2)))


def _overdispersion_of_offset(log: CalibrationLog) -> float:
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    offset = next(c for c in all_candidates(dataset.scene) if c.name == "homing_offset" and c.joint == 1)
    state = start_search(dataset, [offset])
    (fit,) = refine(state.whitener, [], [FittedEffect(offset, np.array(offset.start))])
    return size_overdispersion(replace(state, fitted=(fit,)).refreshed(), fit)
