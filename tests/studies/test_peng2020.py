"""`gpcorrect reproduce peng2020` in its short form: both halves are there, beside the paper's figures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import exit_status

from gpcorrect.errors import DataError
from gpcorrect_studies import peng2020
from gpcorrect_studies.peng2020 import study

SEED = 31


def ended() -> None:
    raise DataError("the run is ended here.")


def test_the_study_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Single ball and end effector within the printed RMS, every method's reductions, every claim with its verdict.

    The first run is ended before its last part; the second one goes on without the pictures and the other estimators.
    """
    small = peng2020.Peng2020Scope(3, 24, (20, 10), 10, 50)
    monkeypatch.setattr(peng2020.Peng2020Scope, "quick", classmethod(lambda _: small))
    words = ("reproduce", "peng2020", "--quick", "--seed", SEED, "-o", tmp_path)
    estimate = study._estimator
    with monkeypatch.context() as patch:
        patch.setattr(study, "_estimator", lambda *given: ended() if given[-1] == "gp" else estimate(*given))
        assert exit_status(*words) != 0
    with monkeypatch.context() as patch:
        patch.setattr(study, "_tracked", lambda *_: ended())
        assert exit_status(*words) == 0
    assert not (tmp_path / "parts.jsonl").exists()
    figures = json.loads((tmp_path / "reproduce.json").read_text())
    printed = figures["printed"]["table1"]
    assert figures["table1"]["single ball"]["length_mm"]["rms"] < printed["single ball"]["length_mm"]["rms"]
    for name in ("end effector", "end effector, a camera hidden"):
        assert figures["table1"][name]["length_mm"]["rms"] < printed["end effector"]["length_mm"]["rms"]
        assert figures["table1"][name]["rotation_rms_deg"] < 0.3
    assert max(figures["cameras_mm"]) < 1.0
    assert set(figures["estimator"]) == {"linear", "network", "gp"}
    assert figures["estimator"]["gp"]["rms_reduction"] > 85.0
    measured = [row for row in figures["claims"] if row["ours"] is not None]
    assert len(measured) == sum(figures["counts"].values()) - figures["counts"]["not measured"] == 22
    page = (tmp_path / "report.html").read_text()
    assert "A short run" in page
    for words in ("0.6273", "83.6 %", "Table I", "rendered", "by axis"):
        assert words in page
