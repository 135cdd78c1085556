"""`gpcorrect reproduce peng2020` in its short form: both halves are there, beside the paper's figures."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from gpcorrect.cli import main
from gpcorrect_studies import peng2020

SEED = 31


def test_the_study_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Single ball and end effector within the paper's figures, every method's reductions, and what is missing said."""
    small = peng2020.Peng2020Scope(3, 24, (20, 10), 10, 50)
    monkeypatch.setattr(peng2020.Peng2020Scope, "quick", classmethod(lambda _: small))
    monkeypatch.setattr(
        sys, "argv", ["gpcorrect", "reproduce", "peng2020", "--quick", "--seed", str(SEED), "-o", str(tmp_path)]
    )
    with pytest.raises(SystemExit) as stopped:
        main()
    assert not stopped.value.code
    figures = json.loads((tmp_path / "reproduce.json").read_text())
    assert figures["table1"]["single ball"]["rms_mm"] < figures["published"]["single_ball_rms_mm"]
    for name in ("end effector", "end effector, a camera hidden"):
        assert figures["table1"][name]["rms_mm"] < figures["published"]["end_effector_rms_mm"]
        assert figures["table1"][name]["rotation_rms_deg"] < 0.3
    assert max(figures["cameras_mm"]) < 1.0
    assert set(figures["estimator"]) == {"linear", "network", "gp"}
    assert figures["estimator"]["gp"]["rms_reduction"] > 85.0
    assert figures["missing"]
