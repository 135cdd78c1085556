"""Rare moments far above the noise: neither nothing nor a name."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log
from discrepancy_support import nominal, verdict_sentence

from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.discrepancy.evidence.bursts import bursts_of
from gpcorrect.discrepancy.evidence.whitener import estimate_noises
from gpcorrect.discrepancy.outcome.sentences import next_step
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.sim.effects import Backlash


def test_a_rare_moment_far_above_the_noise_is_reported_with_its_place() -> None:
    """One motion far above the noise is neither nothing nor a name: the report says where, how large, and when."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[40:60, 9, 1] = 60 * NOISE
    found = find_discrepancy(nominal(), joint_log(5, more=odd))
    assert found.level == Level.INCONCLUSIVE
    assert not found.effects
    (burst,) = found.provenance.bursts
    assert burst.channel.name == "external_jp_2"
    assert burst.trajectories == (9,)
    sentence = verdict_sentence(found)
    assert "outside sensor of joint 2" in sentence
    assert "trajectory 9" in sentence
    assert "like those" in next_step(found)


def test_a_rare_moment_beside_a_named_effect_is_reported_too() -> None:
    """A backlash of joint 1 is named, and what happened once in joint 2 is still told of, with its trajectory."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[40:60, 9, 1] = 60 * NOISE
    found = find_discrepancy(nominal(), joint_log(5, Backlash(1, 40 * NOISE), more=odd))
    assert [(e.name, e.joint) for e in found.effects] == [("backlash", 1)]
    assert [(b.channel.name, b.trajectories) for b in found.provenance.bursts] == [("external_jp_2", (9,))]


def test_what_lasts_and_has_no_name_is_unknown() -> None:
    """A push of a second and a half in one motion: no effect of the catalogue foretells a part of it from the rest."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[40:72, 9, 1] = 60 * NOISE * np.sin(np.linspace(0.3, 2.8, 32))
    found = find_discrepancy(nominal(), joint_log(5, more=odd))
    assert found.level == Level.UNKNOWN
    assert not found.effects
    assert "happens rarely: outside sensor of joint 2" in verdict_sentence(found)
    assert "trajectory 9" in verdict_sentence(found)
    assert "motions like those" in next_step(found)
    assert {p.place: p.level for p in found.verdict.places} == {1: Level.NONE, 2: Level.UNKNOWN}


def test_what_comes_and_goes_in_every_motion_is_unknown() -> None:
    """Pushes of a second at random moments of each motion, from either side: calm lies between them, and no law."""
    rng, odd = np.random.default_rng(11), np.zeros((SAMPLES, RUNS, 2))
    for run in range(RUNS):
        start = int(rng.integers(5, SAMPLES - 30))
        odd[start : start + 20, run, 1] = 12 * NOISE * rng.choice([-1.0, 1.0]) * np.hanning(20)
    found = find_discrepancy(nominal(), joint_log(5, more=odd))
    assert found.level == Level.UNKNOWN
    assert not found.effects
    assert {p.place: p.level for p in found.verdict.places} == {1: Level.NONE, 2: Level.UNKNOWN}


def test_what_is_elsewhere_in_each_motion_is_unknown() -> None:
    """A zero that moves before each motion: no variable foretells the next one, and it was "not decided, too rare"."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[:, :, 1] = 6 * NOISE * np.random.default_rng(3).standard_normal(RUNS)
    found = find_discrepancy(nominal(), joint_log(5, more=odd))
    assert found.level == Level.UNKNOWN
    assert not found.effects
    assert {p.place: p.level for p in found.verdict.places} == {1: Level.NONE, 2: Level.UNKNOWN}


@pytest.mark.parametrize(("motions", "rare"), [(RUNS // 2, True), (RUNS // 2 + 1, False)])
def test_what_happens_in_half_of_the_motions_is_still_rare(motions: int, rare: bool) -> None:
    """The other half says what calm is; and what lasts is to be looked at in pieces."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[40:72, :motions, 1] = 12 * NOISE
    dataset = prepare_data(joint_log(5, more=odd), nominal(), np.random.default_rng(0)).dataset
    noises = estimate_noises(dataset, dataset.residual(), dataset.training)
    (burst,) = bursts_of(dataset, noises)
    assert burst.trajectories == tuple(range(motions))
    assert burst.rare is rare
    assert burst.lasts


def test_noise_alone_has_no_bursts() -> None:
    """Nothing hidden, heavy tails: nothing rare is reported."""
    assert find_discrepancy(nominal(), joint_log(7, tail=4.0)).provenance.bursts == ()
