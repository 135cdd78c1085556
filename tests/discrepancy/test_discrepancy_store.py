"""Stored stages: what was saved comes back, what belongs to other inputs or is damaged does not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discrepancy_core import joint_log
from discrepancy_support import finding, named, outside, result, rival

from gpcorrect.discrepancy import run as workflow
from gpcorrect.discrepancy.evidence.variables import Quantity, Span, Variable
from gpcorrect.discrepancy.naming.selection import name_effects
from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.store import Names, StageStore, inputs_key
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search, Step
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim import model_from_dict
from gpcorrect.sim.effects import EFFECTS, HomingOffset, NoiseChange, TransmissionRatio
from gpcorrect.types import Progress


def test_a_stage_comes_back_for_the_same_inputs_only(tmp_path: Path) -> None:
    """Another seed, a damaged file and a stage that never was all count as absent."""
    store = StageStore(tmp_path / "stages", inputs_key("hash", 0))
    assert store.load("search") is None
    store.save("search", {"fitted": [{"u": [0.1, 2.0]}]})
    assert store.load("search") == {"fitted": [{"u": [0.1, 2.0]}]}
    assert StageStore(tmp_path / "stages", inputs_key("hash", 1)).load("search") is None
    (tmp_path / "stages" / "search.json").write_text('{"key": "')
    assert store.load("search") is None


def test_a_stage_is_of_its_thresholds_and_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who changes a number that decides, or drops an effect in, gets no answer from before."""
    usual = inputs_key("hash", 0)
    tighter = replace(SETTINGS, naming=replace(SETTINGS.naming, exact=0.99))
    monkeypatch.setattr("gpcorrect.discrepancy.outcome.store.SETTINGS", tighter)
    other = inputs_key("hash", 0)
    monkeypatch.setattr("gpcorrect.discrepancy.outcome.store.EFFECTS", {"backlash": EFFECTS["backlash"]})
    assert len({usual, other, inputs_key("hash", 0)}) == 3


def test_evidence_comes_back_as_it_was(tmp_path: Path) -> None:
    """Arrays, labels and steps of the figures survive; those of other inputs and damaged ones do not."""
    rng = np.random.default_rng(0)
    evidence = Evidence(
        before=rng.standard_normal((5, 2)),
        after=rng.standard_normal((5, 2)),
        motor=rng.standard_normal((5, 3)),
        direction=np.sign(rng.standard_normal((5, 3))),
        joint=(0, -1),
        test=np.array([True, False, True, False, False]),
        correlation=np.eye(1),
        labels=("backlash (2)",),
        waterfall=(Step("backlash (2)", 12.5),),
    )
    store = StageStore(tmp_path, "key")
    store.save_result(replace(result("NONE"), evidence=evidence))
    found = store.load_result()
    assert found is not None
    stored = found.evidence
    for name in ("before", "after", "motor", "direction", "test", "correlation"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(evidence, name))
    assert (stored.joint, stored.labels, stored.waterfall) == (evidence.joint, evidence.labels, evidence.waterfall)
    assert StageStore(tmp_path, "other").load_result() is None
    path = tmp_path / "evidence.npz"
    path.write_bytes(path.read_bytes()[:200])
    assert store.load_result() is None


def test_a_run_killed_after_the_naming_goes_on_to_the_same_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Search and names are taken from the store, not made again, and the report is the same."""
    log, model = joint_log(3, HomingOffset(2, 0.02)), model_from_dict({"arm": "joints", "joints": [1, 2]})
    first = find_discrepancy(model, log, stages=tmp_path).to_report()
    (tmp_path / "result.json").unlink()
    for stage in ("search", "name_effects"):
        monkeypatch.setattr(workflow, stage, None)
    second = find_discrepancy(model, log, stages=tmp_path).to_report()
    for report in (first, second):
        del report["provenance"]["seconds"]
    assert first["verdict"]["effects"]
    assert json.dumps(first) == json.dumps(second)


def test_what_a_naming_searched_for_anew_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that goes on after a naming with a search of its own has its steps, its noise and its report."""
    log, model = joint_log(3, TransmissionRatio(2, 0.02)), model_from_dict({"arm": "joints", "joints": [1, 2]})

    def name_after_a_search(done: Search, known: PreparedData, *, progress: Progress) -> Names:
        again = search(replace(done, fitted=()), rounds=1)
        state, names, dropped = name_effects(again, known, progress=progress)
        noisy = replace(state, fitted=()).refreshed()  # as they are where the set has changed since
        return replace(noisy, fitted=state.fitted), names, dropped

    monkeypatch.setattr(workflow, "name_effects", name_after_a_search)
    first = find_discrepancy(model, log, stages=tmp_path)
    (tmp_path / "result.json").unlink()
    for stage in ("search", "name_effects"):
        monkeypatch.setattr(workflow, stage, None)
    second = find_discrepancy(model, log, stages=tmp_path)
    assert len(first.evidence.waterfall) == 2
    assert second.evidence.waterfall == first.evidence.waterfall
    assert second.provenance.noise == first.provenance.noise
    assert second.to_report() | {"provenance": None} == first.to_report() | {"provenance": None}


def test_a_finished_result_comes_back_whole(tmp_path: Path) -> None:
    """Verdict, findings, gaps, noise and model survive the folder: the report is the same to the last digit."""
    effect = named("backlash", 2, "SET", rivals=(rival("coulomb_friction", 2, 0.3),))
    span = Span(Variable(Quantity.POSITION, 2, "rad"), 0.1, 0.2)
    whole = result("SET", effect, findings=(finding(outside(2), span),))
    store = StageStore(tmp_path, "key")
    assert store.load_result() is None
    store.save_result(whole)
    stored = store.load_result()
    assert stored is not None
    assert stored.read_back
    assert (stored.verdict, stored.gap, stored.provenance) == (whole.verdict, whole.gap, whole.provenance)
    assert json.dumps(stored.to_report()) == json.dumps(whole.to_report())


def test_a_model_with_an_infinite_number_comes_back(tmp_path: Path) -> None:
    """Noise with normal tails has infinitely many degrees of freedom, and is in the model as such."""
    whole = result("EXACT", named("backlash", 2))
    noisy = replace(whole, model=whole.model.with_effects(NoiseChange(2, std=1e-3)))
    StageStore(tmp_path, "key").save_result(noisy)
    stored = StageStore(tmp_path, "key").load_result()
    assert stored is not None
    assert stored.model.effects == (NoiseChange(2, std=1e-3),)
    assert np.isinf(NoiseChange(2, std=1e-3).tail)
