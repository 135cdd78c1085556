"""`gpcorrect info` and `models`: what a model file remembers, as a user asks for it."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused
from support import Fitted, sealed_file

from gpcorrect.calibration import load, save
from gpcorrect.calibration.model_file import OLDEST, read_parts


def before_history(path: Path, target: Path) -> Path:
    """Return a copy of a model file as it was before files kept a history."""
    header, arrays = read_parts(path)
    del header["model"]["history"]
    return sealed_file(target, {**header, "schema": OLDEST}, arrays)


def test_a_model_remembers_command_data_versions_and_errors(gpcorrect: CommandLine, fitted: Fitted) -> None:
    """The history of a fitted file is the command as typed, the digest of its log, and the errors that fit printed."""
    result = gpcorrect("info", fitted.model, "--json")
    assert result.code == 0, result.err
    (step,) = result.json["history"]
    assert step["what"] == "fit"
    words = f"gpcorrect fit {fitted.log}".replace(fitted.folder.name, f"unfinished-{fitted.folder.name}")
    assert step["command"].startswith(words)
    assert step["sha256"] == fitted.json["model"]["data"]["sha256"]
    assert step["versions"]["numpy"] == version("numpy")
    assert abs((datetime.now(UTC) - datetime.fromisoformat(step["date"])).days) < 1
    printed = fitted.json["errors"]
    for row in step["held_out"]["errors"]:
        leaf = printed[row["method"]][{"position": "position_mm", "rotation": "rotation_deg"}[row["part"]]]["norm"]
        assert {name: row[name] for name in leaf} == pytest.approx(leaf, rel=1e-12)
    assert len(step["held_out"]["errors"]) == 6
    assert step["held_out"]["samples"] == fitted.json["n_test"]
    assert result.json["hash"] == hashlib.sha256(fitted.model.read_bytes()).hexdigest()


def test_people_read_the_errors_uncut(gpcorrect: CommandLine, fitted: Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal of 40 columns the corrected RMSE and the command are there in full."""
    monkeypatch.setenv("COLUMNS", "40")
    step = gpcorrect("info", fitted.model, "--json").json["history"][0]
    text = gpcorrect("info", fitted.model).out
    assert step["command"] in text
    assert "…" not in text
    assert f"{step['held_out']['errors'][-1]['rmse']:.4f}" in text


def test_a_file_of_before_still_loads(gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path) -> None:
    """It answers as it did; what it does not remember is said, listed and compared as unknown."""
    old = before_history(fitted.model, tmp_path / "old.gpc")
    assert gpcorrect("info", old, "--json").json["history"] == []
    assert "before models kept their history" in gpcorrect("info", old).err
    query = load(fitted.model).check_queries[0]
    np.testing.assert_array_equal(*(load(path).correct(query[:7]).position for path in (old, fitted.model)))
    store = tmp_path / "store"
    gpcorrect("models", "add", old, "--store", store)
    (row,) = gpcorrect("models", "list", "--store", store, "--json").json
    assert (row["made"], row["held_out"]) == ("", [])
    found = gpcorrect("models", "diff", old, fitted.model, "--json").json
    assert found["made"][0] is None
    assert found["commands"]["max_mm"] == 0.0


def test_a_model_saved_again_remembers_the_same(fitted: Fitted, tmp_path: Path) -> None:
    """Loading and saving adds nothing to the history and takes nothing away."""
    corrector = load(fitted.model)
    save(corrector, tmp_path / "again.gpc")
    assert load(tmp_path / "again.gpc").history == corrector.history


def test_the_list_shows_held_out_errors(gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path) -> None:
    """`models list` shows date and RMSE of each model; a damaged file of the store hides no other."""
    store = tmp_path / "store"
    gpcorrect("models", "add", fitted.model, "--store", store)
    gpcorrect("models", "add", before_history(fitted.model, tmp_path / "old.gpc"), "--store", store)
    damaged = next(row for row in gpcorrect("models", "list", "--store", store, "--json").json if row["id"] == "old")
    (store / "models" / f"{damaged['hash']}.gpc").write_bytes(b"x")
    rmse = fitted.json["errors"]["corrected"]["position_mm"]["norm"]["rmse"]
    listed = gpcorrect("models", "list", "--store", store)
    assert listed.code == 0, listed.err
    assert f"{rmse:.3g} mm" in listed.out
    assert "old" in listed.out


def test_words_of_a_file_are_shown_and_not_obeyed(gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path) -> None:
    """Brackets in a history are no markup, and its control characters do not reach the terminal."""
    corrector = load(fitted.model)
    (step,) = corrector.history
    words = "[/b] x [mm] :bomb: \x1b]0;gone\x07\x1b[2J\u202e"
    forged = replace(step, command=words, source=words, date=words, versions={words: words})
    summary = {**corrector.summary, "remarks": [words], "data": {**corrector.summary["data"], "source": words}}
    save(replace(corrector, history=(forged,), summary=summary), tmp_path / "[m].gpc")
    store = tmp_path / "[/store]"
    for command in (
        ("info", tmp_path / "[m].gpc"),
        ("models", "add", tmp_path / "[m].gpc", "--store", store, "--name", words),
        ("models", "list", "--store", store),
        ("models", "diff", tmp_path / "[m].gpc", fitted.model),
    ):
        result = gpcorrect(*command)
        assert result.code == 0, result.err
        assert "[/b] x [mm] :bomb:" in result.out
        assert not set("\x1b\x07\u202e") & set(result.out + result.err)


def test_a_recording_with_brackets_in_its_names_is_shown_as_it_is(
    gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path
) -> None:
    """Units in brackets are not swallowed."""
    log = tmp_path / "run [mm].csv"
    log.write_bytes(fitted.log.read_bytes())
    result = gpcorrect("validate", log)
    assert log.name in result.out


def test_what_is_no_model_is_refused(gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path) -> None:
    """A log, and a file that is not there."""
    assert_refused(gpcorrect("info", fitted.log), "no model file")
    assert_refused(gpcorrect("info", tmp_path / "none.gpc"), "no model file")
