"""`gpcorrect compare`: two models on the same samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from command_line import CommandLine, assert_refused, written
from joint_logs import joint_log
from support import Fitted, Once, small_log

from gpcorrect.calibration import CommandCorrector, FitSettings, JointCorrector, fit_model, load, measure_both, save

NONE = ("--time-offset", "none")


@pytest.fixture(scope="module")
def bent(once: Once) -> Path:
    """Return another model of the same arm, from another recording and method."""
    settings = FitSettings(method="linear", features=("pose",), marker="none", time_offset="none")
    log = small_log(3, trajectories=6, samples=40)
    return once.file("bent.gpc", lambda path: save(fit_model(log, settings).corrector, path))


@pytest.fixture(scope="module")
def joints(once: Once) -> Path:
    """Return a model of joints."""
    log = joint_log(1, trajectories=4, seconds=8.0)
    settings = FitSettings(method="offset", time_offset="none")
    return once.file("offset.gpc", lambda path: save(fit_model(log, settings, task=JointCorrector).corrector, path))


def test_both_are_measured_as_each_alone(gpcorrect: CommandLine, small_model: Path, bent: Path, tmp_path: Path) -> None:
    """Where cleaning rejects nothing, the figures of each model are those of `evaluate`; the page names both."""
    log = written(small_log(5, trajectories=5), tmp_path / "new.csv")
    page = tmp_path / "compare.html"
    found = gpcorrect("compare", small_model, bent, log, *NONE, "--report", page, "--json").json
    assert found["samples"] == 300
    for model, path in zip(found["models"], (small_model, bent), strict=True):
        alone = gpcorrect("evaluate", path, log, *NONE, "--json").json
        rows = {(row["method"], row["part"]): row["rmse"] for row in model["errors"]}
        for method, parts in alone["errors"].items():
            assert rows[method, "position"] == pytest.approx(parts["position_mm"]["norm"]["rmse"])
            assert rows[method, "rotation"] == pytest.approx(parts["rotation_deg"]["norm"]["rmse"])
        assert model["coverage95"] == pytest.approx(alone["coverage95"])
        assert model["in_domain"] == pytest.approx(alone["in_domain"])
    assert [row["trajectory"] for row in found["trajectories"]] == list(range(5))
    low, high = found["differences"][0]["interval95"]
    assert 0 < low < found["differences"][0]["mean"] < high
    text = page.read_text()
    assert "model errs less" in text
    assert text.count("SHA-256") >= 3


def test_the_difference_turns_round_with_the_models(small_corrector: CommandCorrector, bent: Path) -> None:
    """What the second has above the first, the first lacks of the second; a model does not differ from itself."""
    log, other = small_log(5, trajectories=5), load(bent)
    there, back = (
        measure_both(*pair, log).differences() for pair in ((small_corrector, other), (other, small_corrector))
    )
    assert [d.mean for d in there] == pytest.approx([-d.mean for d in back])
    itself = measure_both(small_corrector, small_corrector, log).differences()
    assert all(d.mean == 0 and d.interval95 == (0, 0) for d in itself)


def test_a_table_for_people_names_what_was_learned_from(
    gpcorrect: CommandLine, small_model: Path, bent: Path, fitted: Fitted
) -> None:
    """Whole numbers of both models stand in the table, and a model that knows the recording is said to know it."""
    said = gpcorrect("compare", small_model, bent, fitted.log, *NONE)
    assert "model: the model was made from this recording" in said.err
    assert "errs less" in said.out
    assert "trajectory  samples  position [mm] model  position [mm] bent" in said.out


def test_models_that_cannot_stand_side_by_side_are_refused(
    gpcorrect: CommandLine, small_model: Path, bent: Path, joints: Path, tmp_path: Path
) -> None:
    """Models of poses and of joints, and models of two arms, are refused in words before the recording is read."""
    refused = gpcorrect("compare", small_model, joints, tmp_path / "none.csv")
    assert_refused(refused, "model corrects pose, offset joints: their errors cannot be compared", "gpcorrect info")
    copy = tmp_path / "copy.gpc"
    copy.write_bytes(bent.read_bytes())
    assert_refused(gpcorrect("compare", bent, copy, tmp_path / "none.csv"), "copy.gpc are one model", "two models")
    left, right = (tmp_path / f"{arm}.gpc" for arm in ("left", "right"))
    for path in (left, right):
        model = load(bent)
        save(replace(model, summary={**model.summary, "robot": "raven2", "arm": path.stem}), path)
    refused = gpcorrect("compare", left, right, tmp_path / "none.csv")
    assert_refused(refused, "left is of the arm left, right right")
