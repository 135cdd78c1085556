"""What is named is the same in every motion, and of two laws of one family the fuller one has its say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discrepancy_core import RUNS, SAMPLES, joint_log, motors
from discrepancy_support import named, nominal, verdict_sentence

from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.discrepancy.naming.weigh import own_gain, weigh
from gpcorrect.discrepancy.outcome.sentences import next_step
from gpcorrect.discrepancy.outcome.verdict import closed_where_they_show
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search, view_of
from gpcorrect.sim.effects import Backlash, CableSlip, Hysteresis, PulleyEccentricity
from gpcorrect.types import CalibrationLog, FloatArray

ERROR, WAVES = 0.01, 6.0
REVERSALS = ("backlash", "hysteresis")


def _wave(spread: float) -> CalibrationLog:
    """Return a wave of joint 1 over its position, whose size differs by that part of itself between motions."""
    plain = joint_log(3)
    seen = joint_log(3, PulleyEccentricity(joint=1, amplitude=ERROR, waves=WAVES, phase=0.3))
    of_run = 1.0 + spread * np.random.default_rng(5).standard_normal(RUNS)
    size = np.repeat(of_run, SAMPLES)[:, None]
    return replace(seen, external_jp=plain.external_jp + size * (seen.external_jp - plain.external_jp))


@pytest.mark.parametrize(("spread", "level"), [(0.0, Level.EXACT), (0.6, Level.UNKNOWN)])
def test_a_size_that_differs_from_motion_to_motion_is_no_name(spread: float, level: Level) -> None:
    """The same wave is named where it is as large in every motion, and is something unknown where it is not."""
    found = find_discrepancy(nominal(), _wave(spread))
    assert found.level == level
    assert {e.name for e in found.effects} == ({"pulley_eccentricity"} if level == Level.EXACT else set())
    if level == Level.UNKNOWN:
        assert any("from trajectory to trajectory" in r for n in found.not_named for r in n.reasons)


def test_what_a_machine_only_acts_like_closes_the_gap_and_has_no_name() -> None:
    """A wheel turns the same in every motion: a wave whose size differs by a fifth of itself is something else."""
    found = find_discrepancy(nominal(), _wave(0.2))
    assert found.level == Level.UNKNOWN
    assert found.effects == ()
    assert {p.place: p.level for p in found.verdict.places} == {1: Level.UNKNOWN, 2: Level.NONE}
    assert [effect.about.name for effect in found.model.effects] == ["pulley_eccentricity"]
    assert found.gap[0].closed > 0.8
    assert "acts like pulley eccentricity (joint 1), but by another size in every motion" in verdict_sentence(found)
    assert "from motion to motion" in next_step(found)
    (alike,) = found.to_report()["verdict"]["alike"]
    assert alike["name"] == "pulley_eccentricity"
    assert 0.1 < alike["spread"] < 0.4


@pytest.mark.parametrize(("name", "held_to_it"), [("pulley_eccentricity", True), ("backlash", False), ("creep", False)])
def test_friction_and_creep_may_differ_between_motions(name: str, held_to_it: bool) -> None:
    """Friction depends on load and wear, and no log holds the pauses that a creep remembers; geometry is one thing."""
    assert named(name, 1, spread=0.2).is_a_name is not held_to_it


def test_what_closes_but_a_part_of_a_gap_has_no_name() -> None:
    """A backlash beside a product of two positions, on one joint: what it leaves is beyond doubt no noise."""
    q = motors(np.random.default_rng(3))[1]
    more = np.zeros(q.shape)
    more[..., 0] = 0.05 * q[..., 0] * q[..., 1]
    found = find_discrepancy(nominal(), joint_log(3, Backlash(1, 0.007), more=more))
    assert found.level == Level.UNKNOWN
    assert found.effects == ()
    (alike,) = found.verdict.alike
    assert alike.name == "backlash"
    assert 0.4 < alike.closes < 0.8
    assert "(joint 1), but closes only" in verdict_sentence(found)
    assert "maps below" in next_step(found)


def test_effects_that_show_in_one_channel_share_what_they_leave() -> None:
    """What is left counts where it is plain; who shows beside an effect there was fitted together with it."""
    shown: dict[str, list[float]] = {"delay": [2.0, 0.0, 0.0], "resonance": [1.0, 1.0, 0.0], "wave": [0.0, 0.0, 1.0]}

    def changes(effects: Sequence[str]) -> FloatArray:
        return np.stack([np.tile(shown[e], (5, 1)) for e in effects], axis=2)

    def together(a: str, b: str) -> bool:
        return bool(np.any(np.multiply(shown[a], shown[b])))

    state: Any = SimpleNamespace(dataset=SimpleNamespace(changes=changes), alike=together)
    fitted: Any = [SimpleNamespace(effect=name, candidate=name) for name in shown]
    gaps: Any = [SimpleNamespace(channel=i, closed=0.5, noise=1.0) for i in range(3)]
    plain, faint = ({"counts": True, "size": size, "nats": 100.0} for size in (0.5, 0.2))
    findings = [SimpleNamespace(channel=0, **plain), SimpleNamespace(channel=2, **faint)]
    left: Any = SimpleNamespace(findings=findings, threshold=10.0)
    assert closed_where_they_show(state, fitted, gaps, left) == [0.5, 0.5, 1.0]


def test_a_slip_after_the_last_motion_of_the_confirmation_part_has_its_name() -> None:
    """No motion of that part could confirm it; those of discovery foretell one another beyond doubt."""
    log, seed = joint_log(3, CableSlip(1, 0.003, instant=604.0)), 13
    dataset = prepare_data(log, nominal(), np.random.default_rng(seed)).dataset
    assert dataset.trajectory[dataset.confirmation].max() < 10
    found = find_discrepancy(nominal(), log, seed=seed)
    assert found.level == Level.EXACT
    assert [e.name for e in found.effects] == ["cable_slip"]


def test_a_fuller_law_of_a_rival_is_weighed() -> None:
    """After a reversal half of the motion is lost, with a corner where it ends: a backlash loses all of it.

    So does the plain law of a hysteresis; the one with a depth of its own is better, and pays for its shape.
    """
    hidden = Hysteresis(joint=1, radius=0.0015, sharpness=8.0, depth=0.5, law="plays")
    prepared = prepare_data(joint_log(5, hidden), nominal(), np.random.default_rng(0))
    reversals = [c for c in all_candidates(prepared.dataset.scene) if c.joint == 1 and c.name in REVERSALS]
    state = start_search(prepared.dataset, reversals)
    slack = next(t.candidate for t in state.traces if t.candidate.name == "backlash")
    (fit,) = refine(state.whitener, [], [FittedEffect(slack, np.array(slack.start))], 30)
    view = view_of(replace(state, fitted=(fit,)), prepared)
    weighed = weigh(view, fit, own_gain(view, fit))
    (rival,) = weighed.rivals
    assert rival.candidate.name == "hysteresis"
    assert "depth" in rival.candidate.places
    assert rival.nats > weighed.own.nats + 10.0
    assert 0.0 < rival.shape_nats < np.inf
