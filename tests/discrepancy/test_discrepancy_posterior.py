"""What a name rests on: probabilities from evidence made by hand, what is closed of the gap, overtones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log, motors
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.occam import price_of
from gpcorrect.discrepancy.naming.posterior import (
    Alternative,
    Explanation,
    Level,
    _level,
    fraction_closed,
    overtone_nats,
    posterior,
)
from gpcorrect.discrepancy.naming.weigh import Own, Rival, Weighed
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import Search, start_search, view_of
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim import model_from_dict
from gpcorrect.sim.effects import HomingOffset, PulleyEccentricity
from gpcorrect.types import CalibrationLog

COST = 10.0
SEED, WAVES, SIZE = 2, 6.0, 10 * NOISE  # of a wheel off its centre


@pytest.fixture(scope="module")
def catalogue() -> dict[str, Candidate]:
    """Return candidates of one bare joint by their names."""
    q = np.linspace(0.0, 1.0, 50)[:, None]
    zeros = np.zeros(50, dtype=np.int64)
    log = CalibrationLog(
        time=np.arange(50) / 10.0, trajectory=zeros, session=zeros, measured_jp=q, setpoint_jp=q, external_jp=q
    )
    model = model_from_dict({"arm": "joints", "joints": [1], "joint_types": "R"})
    scene = build_scene(log, model, np.ones(50, dtype=np.bool_))
    return {c.name: c for c in reversed(all_candidates(scene))}  # the plainest of each name


def _weighed(
    own: float,
    rival: Candidate,
    nats: float,
    *,
    beside: float = 0.0,
    shape_nats: float = np.inf,
    more: int = 0,
    of_steps: float = 0.0,
) -> Weighed:
    fit = FittedEffect(rival, np.array(rival.start))
    nothing = np.zeros(0)
    gain = Own((), (nothing, nothing), np.array([own]), np.zeros(1), 1.0, of_steps)
    rivals = (Rival(fit, nats, SETTINGS.search.complexity * more, shape_nats),)
    return Weighed(gain, 0.0, np.ones(2, dtype=np.bool_), rivals, 0.0, beside)


def test_probabilities_sum_to_one_and_follow_the_evidence(catalogue: dict[str, Candidate]) -> None:
    """A rival two nats behind is e^-2 as probable when both have as many numbers."""
    own, rival = catalogue["transmission_ratio"], catalogue["homing_offset"]
    assert own.extra == rival.extra
    found = posterior(own, _weighed(100.0, rival, 98.0), COST)
    assert sum(a.probability for a in found) == pytest.approx(1.0)
    assert found[-1].probability / found[0].probability == pytest.approx(np.exp(-2.0))


def test_of_two_that_explain_alike_the_simpler_is_more_probable(catalogue: dict[str, Candidate]) -> None:
    """Numbers beyond the first have a price, whatever else is still missing."""
    simple, flexible = catalogue["backlash"], catalogue["pulley_eccentricity"]
    assert flexible.extra > simple.extra
    more = flexible.extra - simple.extra
    for beside in (0.0, 400.0):
        mine, *_, rival = posterior(simple, _weighed(5000.0, flexible, 5000.2, beside=beside, more=more), COST)
        assert mine.probability > 0.95 > rival.probability


def test_two_forms_of_one_effect_are_no_rivals(catalogue: dict[str, Candidate]) -> None:
    """A gain on speed alone and both gains are both called `gain_error`, and the one is a case of the other."""
    both = catalogue["gain_error"]
    derivative = replace(both, fixed=(("gains", "derivative"),))
    found = posterior(derivative, _weighed(100.0, both, 100.0), COST)
    assert [a.label for a in found if a.is_effect] == [derivative.label]


@pytest.mark.parametrize(
    ("own", "lead", "beside", "stays"),
    [
        # What neither explains may favour either.
        (1000.0, 40.0, {"beside": COST}, False),
        (1000.0, 40.0, {"beside": 30.0 + COST}, False),
        (1000.0, 40.0, {"beside": 60.0 + COST}, True),
        # A centre of mass took up some of how MuJoCo steps its loop, and a link's mass was ruled out by 11 nats.
        (8227.0, 20.0, {"of_steps": 0.0}, False),
        (8227.0, 20.0, {"of_steps": 9.0}, False),
        (8227.0, 20.0, {"of_steps": 22.0}, True),
        # A thousandth of very many nats is no evidence between two models that are both approximate.
        (1e3, 80.0, {}, False),
        (1e5, 80.0, {}, True),
    ],
)
def test_a_lead_smaller_than_what_may_favour_either_leaves_the_rival(
    catalogue: dict[str, Candidate], own: float, lead: float, beside: dict[str, float], stays: bool
) -> None:
    """What is still missing, what the servo's steps are worth, what an error of our own signatures could make."""
    rival = catalogue["homing_offset"]
    found = posterior(catalogue["transmission_ratio"], _weighed(own, rival, own - lead, **beside), COST)
    assert (found[-1].probability >= SETTINGS.naming.stable) is stays


def test_a_fuller_law_whose_shape_the_data_leave_open_is_not_ruled_out_and_never_leads(
    catalogue: dict[str, Candidate],
) -> None:
    """Numbers of which the data say nothing cost nothing, up to a draw; those that they say cost what is said."""
    own, fuller = catalogue["backlash"], catalogue["pulley_eccentricity"]
    for lead, shape_nats, odds in ((0.0, 0.5, -0.5), (3.0, 0.5, 0.0), (-1.0, 1.0, -2.0), (0.0, 60.0, -8.0)):
        mine, *_, rival = posterior(own, _weighed(100.0, fuller, 100.0 + lead, shape_nats=shape_nats, more=2), COST)
        assert rival.probability / mine.probability == pytest.approx(np.exp(odds))


def test_a_value_a_session_costs_as_much_as_one_for_all() -> None:
    """A joint homed wrongly in one session of two has one number, and not one less for the session without."""
    state, _ = _with_offset(joint_log(2, HomingOffset(joint=1, offset=(0.0, 20 * NOISE)), sessions=2), 20 * NOISE)
    candidate = state.fitted[0].candidate
    assert len(candidate.coordinates) == 2
    fit = FittedEffect(candidate, np.array([0.0, candidate.coordinates[1].coordinate(20 * NOISE)]))
    assert price_of(state, [fit], fit, 1.0) == SETTINGS.search.complexity * candidate.extra


def _with_offset(log: CalibrationLog, offset: float) -> tuple[Search, FittedEffect]:
    dataset = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    candidate = next(c for c in all_candidates(dataset.scene) if c.name == "homing_offset" and c.joint == 1)
    fit = FittedEffect(candidate, np.array([c.coordinate(offset) for c in candidate.coordinates]))
    state = start_search(dataset, [candidate])
    white = tuple(replace(n, white=NOISE, slow=0.0) for n in state.whitener.noises)
    return replace(state, fitted=(fit,), whitener=replace(state.whitener, noises=white)), fit


def test_the_right_effect_closes_the_gap_and_a_small_part_of_something_else_does_not() -> None:
    """An offset that is there closes all; a twentieth of a large step in its place leaves nearly all."""
    assert fraction_closed(*_with_offset(joint_log(2, HomingOffset(joint=1, offset=20 * NOISE)), 20 * NOISE)) == 1.0
    step = np.zeros((SAMPLES, RUNS, 2))
    step[..., 0] = 20 * NOISE * np.sign(motors(np.random.default_rng(2))[1][..., 0])
    assert fraction_closed(*_with_offset(joint_log(2, more=step), NOISE)) < SETTINGS.naming.least_closed


def wave_gains(log: CalibrationLog) -> tuple[float, float]:
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
    own, others = wave_gains(wave(0.0))
    assert own > 100.0
    assert others < 5.0


def test_a_periodic_error_of_another_kind_has() -> None:
    own, others = wave_gains(wave(0.9))
    assert others > SETTINGS.naming.most_overtones * own


def test_effects_that_are_not_periodic_have_none_to_look_for() -> None:
    assert HomingOffset(joint=1, offset=0.1).overtones() == ()
    overtones = PulleyEccentricity(joint=1, amplitude=0.1, waves=3.0, phase=0.0).overtones()
    assert {o.waves for o in overtones} == {6.0, 9.0, 12.0}


@pytest.mark.parametrize(
    ("own", "unknown", "rivals", "level"),
    [
        (0.985, 0.005, [0.01], Level.EXACT),
        (0.977, 0.005, [0.018], Level.CLASS),  # below the limit, and yet with the unknown it is more than that
        (0.95, 0.0, [0.019, 0.018, 0.013], Level.CLASS),
        (0.90, 0.005, [0.09], Level.CLASS),
        (0.97, 0.03, [], Level.INCONCLUSIVE),
        (0.96, 0.03, [0.01], Level.INCONCLUSIVE),
    ],
)
def test_every_effect_that_may_be_it_is_named_unless_what_is_unknown_may(
    own: float, unknown: float, rivals: list[float], level: Level
) -> None:
    """A stretch of 1.5 million nats got no name: its rival was just below the limit, and so was its lead."""
    effects = [
        Alternative(Explanation.EFFECT, p, f"law {i}", family="compliance") for i, p in enumerate([own, *rivals])
    ]
    others = [Alternative(Explanation.NOTHING, 0.0, "nothing"), Alternative(Explanation.UNKNOWN, unknown, "unknown")]
    found, reasons = _level([effects[0], *others, *effects[1:]], [], [])
    assert found == level
    assert (level == Level.CLASS) == any("law 1" in reason for reason in reasons)
