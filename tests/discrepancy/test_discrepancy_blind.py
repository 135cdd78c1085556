"""The blind dataset in small: another simulator's recordings, made, solved and scored end to end."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))

from discrepancy_cases import Job, label_of, outcome_of, solve
from truth import Spec, make_case


def small(suite: str, *hidden: str) -> Spec:
    """Return a case of bare joints, which needs no servo loop: 12 trajectories of 5 s."""
    return Spec(suite, hidden, 2.0, signals="bare", trajectories=12, seconds=5.0)


def test_labels_of_the_truth_are_scored_as_they_are_meant() -> None:
    """Suites become sets, parameters stand beside the name, and what is outside the catalogue is marked."""
    known = label_of(dict(make_case(small("one", "homing_offset"), 7).labels))
    assert known["set"] == "single"
    (effect,) = known["effects"]
    assert (effect["name"], effect["known"]) == ("homing_offset", True)
    assert "offset" in effect
    assert label_of(dict(make_case(small("null"), 7).labels)) == {"set": "null", "effects": [], "effect_to_noise": None}


@pytest.mark.slow
def test_a_case_is_solved_and_scored_beside_the_baselines() -> None:
    """Nothing wrong is named where nothing is hidden; workflow and baselines are scored on the same case."""
    entry = solve(Job(small("null"), 7, baselines=True))
    outcome = outcome_of(entry["outcome"])
    assert outcome.group == "null"
    assert not outcome.wrong
    assert set(entry["baselines"]) == {"stepwise BIC a sample", "STLSQ (SINDy)", "nearest signature"}
