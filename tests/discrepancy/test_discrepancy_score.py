"""Scoring: what counts as named, wrong, unknown, and how shares become targets."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from discrepancy_support import named, result, rival

from gpcorrect.discrepancy.outcome.result import NamedEffect
from gpcorrect.discrepancy.protocol.outcomes import case_outcome
from gpcorrect.discrepancy.protocol.score_reports import (
    Proportion,
    read_labels,
    read_reports,
    score_cases,
    score_reports,
    score_text,
)
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.errors import DataError


def report(level: str, *effects: NamedEffect, sha256: str = "abc") -> dict[str, Any]:
    """Return report.json of a result."""
    return result(level, *effects, sha256=sha256).to_report()


def label(*effects: dict[str, Any], group: str = "single", ratio: float | None = 1.0) -> dict[str, Any]:
    return {"set": group, "effects": list(effects), "effect_to_noise": ratio, "log_sha256": "abc"}


BACKLASH = {"name": "backlash", "joint": 2, "known": True, "radius": 0.0105}


def test_an_exact_name_counts_with_its_interval_and_gap() -> None:
    """The right name alone is exact, its interval is checked, and the closed gap is that of its joint."""
    outcome = case_outcome("a", label(BACKLASH), report("EXACT", named("backlash", 2)))
    assert outcome.exact
    assert not outcome.wrong
    assert outcome.covered == (True,)
    assert outcome.closed == pytest.approx(0.992)
    assert outcome.probabilities == ((0.97, True),)


def test_a_phase_is_covered_a_turn_later_too() -> None:
    """A phase of -3.1 rad is inside an interval that ends at 3.3, and one of -2.5 is not."""
    found = replace(named("pulley_eccentricity", 2), parameters={"phase": Estimate(3.0, (2.8, 3.3), "rad")})
    for phase, inside in ((-3.1, True), (-2.5, False), (2.9, True)):
        truth = {"name": "pulley_eccentricity", "joint": 2, "known": True, "phase": phase}
        assert case_outcome("a", label(truth), report("EXACT", found)).covered == (inside,)


@pytest.mark.parametrize(("source", "answer"), [(3, "set"), (2, "wrong set")])
def test_a_class_holds_an_effect_only_with_the_joint_that_drives_it(source: int, answer: str) -> None:
    """What a rival is driven by stands in the report: without it, a class that holds the truth was scored as wrong."""
    truth = {"name": "length_dependent_stiffness", "joint": 2, "known": True, "source": 3}
    other = replace(rival("length_dependent_stiffness", 2, 0.3), source=source)
    found = named("cable_stretch", 2, level="CLASS", rivals=(other,))
    assert case_outcome("a", label(truth), report("CLASS", found)).answers == (answer,)


def test_another_joint_or_name_is_wrong() -> None:
    """A true name on the wrong joint is a wrong name, and so is another name on the right joint."""
    for entry in (named("backlash", 1), named("coulomb_friction", 2)):
        outcome = case_outcome("a", label(BACKLASH), report("EXACT", entry))
        assert outcome.wrong
        assert not outcome.exact
        assert outcome.answers == (entry.name,)


def test_a_set_with_the_truth_is_no_wrong_name() -> None:
    """A set that holds the truth among its rivals is right_or_set; one without it is wrong."""
    other = rival("backlash", 2, 0.3)
    holding = case_outcome("a", label(BACKLASH), report("SET", named("coulomb_friction", 2, "SET", rivals=(other,))))
    assert (holding.right_or_set, holding.wrong, holding.answers) == (True, False, ("set",))
    without = case_outcome("a", label(BACKLASH), report("SET", named("coulomb_friction", 2, "SET")))
    assert (without.right_or_set, without.wrong, without.answers) == (False, True, ("wrong set",))


def test_a_coupling_from_another_joint_is_wrong() -> None:
    """The joint that a coupling comes from is part of its name."""
    truth = {"name": "cable_coupling", "joint": 2, "known": True, "source": 1}
    other = {"source": Estimate(3, None, "")}
    assert case_outcome("a", label(truth), report("EXACT", named("cable_coupling", 2, parameters=other))).wrong


def test_outside_the_catalogue_only_unknown_is_right() -> None:
    """An unknown cause is answered by UNKNOWN; any name is then wrong, the same name included."""
    outside = label({"name": "cogging", "joint": 2, "known": False}, group="outside")
    assert case_outcome("a", outside, report("UNKNOWN")).unknown
    misled = case_outcome("a", outside, report("UNKNOWN", named("backlash", 2)))
    assert misled.wrong
    assert not misled.unknown


def test_the_target_table_counts_each_set() -> None:
    """Null, single and outside cases land in their rows with their shares, and in the confusion matrix."""
    outcomes = [
        case_outcome("n1", label(group="null", ratio=None), report("NONE")),
        case_outcome("n2", label(group="null", ratio=None), report("EXACT", named("backlash", 1))),
        case_outcome("s1", label(BACKLASH), report("EXACT", named("backlash", 2))),
        case_outcome("o1", label({"name": "cogging", "joint": 1, "known": False}, group="outside"), report("UNKNOWN")),
    ]
    score = score_cases(outcomes)
    table = {t.what: t for t in score.targets}
    assert table["null: any name"].value == 0.5
    assert not table["null: any name"].met
    assert table["single, effect/noise 1: exact"].met
    assert table["outside: UNKNOWN"].value == 1.0
    assert score.confusion["nothing"] == score.confusion["nothing"] | {"none": 1, "backlash": 1}
    assert score.confusion["cogging"]["unknown"] == 1
    assert score.limits == {"backlash": 1.0}
    text = score_text(score)
    assert "null: any name" in text
    assert "at most 1 %" in text


@pytest.mark.parametrize("group", ["null", "single"])
def test_a_ratio_of_zero_is_near_no_target(group: str) -> None:
    """A case whose effect to noise is 0 counts in its set where that has one line, and at no ratio's line."""
    case = {"a": label(*[BACKLASH] * (group == "single"), group=group, ratio=0.0)}
    found = score_reports(case, [("a", report("NONE"))])
    assert not [t for t in found.targets if "effect/noise" in t.what and not t.what.startswith("gap closed")]
    assert [t.n for t in found.targets if t.what == "null: any name"] == [1] * (group == "null")
    assert found.limits == {}


def test_the_wilson_interval_holds_the_fraction_and_shrinks() -> None:
    """The interval lies inside 0 to 1, holds the fraction, and is narrower for more cases; of none it is undefined."""
    few, many = Proportion(9, 10).interval, Proportion(900, 1000).interval
    assert 0.0 <= few[0] < 0.9 < few[1] <= 1.0
    assert many[1] - many[0] < few[1] - few[0]
    assert few == pytest.approx((0.5958, 0.9821), abs=1e-4)
    assert np.isnan(Proportion(0, 0).interval).all()


def test_reports_are_matched_by_the_recordings_hash(tmp_path: Path) -> None:
    """Whatever its folder is called, a report is scored against its recording; labels left over are named."""
    for folder, sha256 in (("x", "abc"), ("y", "nope")):
        (tmp_path / folder).mkdir()
        said = report("EXACT", named("backlash", 2), sha256=sha256)
        (tmp_path / folder / "report.json").write_text(json.dumps(said))
    labels = {"case_000": label(BACKLASH), "case_001": label(BACKLASH) | {"log_sha256": "other"}}
    score = score_reports(labels, read_reports([tmp_path / "x"]))
    assert score.missing == ("case_001",)
    with pytest.raises(DataError, match="no recording in the labels"):
        score_reports(labels, read_reports([tmp_path]))
    with pytest.raises(DataError, match=r"holds no report\.json"):
        read_reports([tmp_path / "x" / "nothing"])
    (tmp_path / "y" / "report.json").write_text('{"some": "page"}')
    with pytest.raises(DataError, match="no report of"):
        read_reports([tmp_path / "y"])


def test_changed_labels_are_refused(tmp_path: Path) -> None:
    """Labels whose hash is not the sealed one are not scored with."""
    (tmp_path / "sealed").mkdir()
    path = tmp_path / "sealed" / "labels.json"
    path.write_text(json.dumps({"cases": {}}))
    (tmp_path / "labels.sha256").write_text(hashlib.sha256(path.read_bytes()).hexdigest() + "  labels.json\n")
    assert read_labels(path) == {}
    path.write_text(json.dumps({"cases": {"case_000": label(BACKLASH)}}))
    with pytest.raises(DataError, match="not what was sealed"):
        read_labels(path)
    path.write_text('{"cases": 3}')
    with pytest.raises(DataError, match="cannot read the labels"):
        read_labels(path)
