"""Kept stages: what was saved comes back, what belongs to other inputs or is damaged does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.store import StageStore, inputs_key
from gpcorrect.discrepancy.search.state import Step


def test_a_stage_comes_back_for_the_same_inputs_only(tmp_path: Path) -> None:
    """Another seed, a damaged file and a stage that never was all count as absent."""
    store = StageStore(tmp_path / "stages", inputs_key("hash", 0))
    assert store.load("search") is None
    store.save("search", {"members": [{"u": [0.1, 2.0]}]})
    assert store.load("search") == {"members": [{"u": [0.1, 2.0]}]}
    assert StageStore(tmp_path / "stages", inputs_key("hash", 1)).load("search") is None
    (tmp_path / "stages" / "search.json").write_text('{"key": "')
    assert store.load("search") is None


def test_evidence_comes_back_as_it_was(tmp_path: Path) -> None:
    """Arrays, labels and steps of the figures survive; those of other inputs and damaged ones do not."""
    rng = np.random.default_rng(0)
    evidence = Evidence(
        before=rng.standard_normal((5, 2)),
        after=rng.standard_normal((5, 2)),
        motor=rng.standard_normal((5, 3)),
        direction=np.sign(rng.standard_normal((5, 3))),
        joint=(0, -1),
        sealed=np.array([True, False, True, False, False]),
        correlation=np.eye(1),
        labels=("backlash (2)",),
        waterfall=(Step("backlash (2)", 12.5),),
    )
    store = StageStore(tmp_path, "key")
    store.save_evidence(evidence)
    kept = store.load_evidence()
    assert kept is not None
    for name in ("before", "after", "motor", "direction", "sealed", "correlation"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(evidence, name))
    assert (kept.joint, kept.labels, kept.waterfall) == (evidence.joint, evidence.labels, evidence.waterfall)
    assert StageStore(tmp_path, "other").load_evidence() is None
    path = tmp_path / "evidence.npz"
    path.write_bytes(path.read_bytes()[:200])
    assert store.load_evidence() is None
