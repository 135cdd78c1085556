"""`update`, `drift` and `explore` as a user runs them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused, written
from support import small_log

from gpcorrect.calibration import load, save
from gpcorrect.types import PoseSignal


@pytest.fixture
def model(small_model: Path) -> Path:
    return small_model


@pytest.fixture
def days(tmp_path: Path) -> list[Path]:
    """Return recordings of two days: motions of the training, with noise of their own."""
    both = small_log(0, 12, samples=40)
    parts = [both.select(both.trajectory < 6), both.select(both.trajectory >= 6)]
    return [written(part, tmp_path / f"day{number}.csv") for number, part in enumerate(parts)]


def test_update_writes_another_model_and_leaves_the_first(
    gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path
) -> None:
    """--output is written, MODEL keeps every byte, and JSON tells both errors and the weight of the old data."""
    before = model.read_bytes()
    result = gpcorrect("update", model, days[0], "--output", tmp_path / "new.gpc", "--force", "--json")
    assert result.code == 0, result.err
    assert result.json["n_added"] > 100
    assert 0 < result.json["keep"] <= 1
    assert result.json["after"]["errors"]["corrected"]
    assert model.read_bytes() == before
    updated = load(tmp_path / "new.gpc")
    assert len(updated.info()["updates"]) == 1
    fit, update = updated.history
    assert (fit.what, update.what) == ("fit", "update")
    assert str(days[0]) in update.command
    assert update.held_out is not None
    measured = result.json["after"]["errors"]["corrected"]["position_mm"]["norm"]
    assert update.held_out.corrected[0].rmse == pytest.approx(measured["rmse"], rel=1e-12)


def test_drift_draws_and_answers(gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path) -> None:
    """Two healthy days raise no alarm, and the page says so; scores are one a trajectory of the training region."""
    result = gpcorrect("drift", model, *days, "--age", 1, "--age", 2, "--report", tmp_path / "d.html", "--json")
    assert result.code == 0, result.err
    assert result.json["alarm"] is False
    assert len(result.json["scores"]) == 12
    assert result.json["unit"] == "days"
    page = (tmp_path / "d.html").read_text()
    assert "no alarm" in page
    assert page.count('class="chart"') == 1
    assert "trajectories" in gpcorrect("drift", model, *days).out
    assert result.json["ageing"] is None  # two days make no line


def test_drift_tells_an_arm_that_changed_by_one_short_day(
    gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path
) -> None:
    """Six motions of an arm that errs by more are too few for the sequence; as one recording they raise the alarm."""
    log = small_log(3, 6, samples=40)
    assert log.tracker_cp is not None
    bent = log.tracker_cp.position + 0.002 * np.cos(40 * log.tracker_cp.position[:, [2, 0, 1]])
    changed = written(replace(log, tracker_cp=replace(log.tracker_cp, position=bent)), tmp_path / "changed.csv")
    result = gpcorrect("drift", model, days[0], changed, "--json")
    assert result.code == 0, result.err
    healthy, worse = result.json["recordings"]
    assert result.json["alarm"] is True
    assert worse["chance"] < 1e-4 < healthy["chance"]
    assert worse["coverage95_worst"] <= worse["coverage95"] < healthy["coverage95"]
    said = gpcorrect("drift", model, changed).out
    assert "larger than at the fit in" in said
    assert "changed.csv: 6 trajectories" in said


def test_drift_leaves_the_training_out(gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path) -> None:
    """Scores of a recording that the model was made from are those of a model that knows the answers."""
    training = written(small_log(), tmp_path / "training.csv")
    alone, after = gpcorrect("drift", model, days[1], "--json"), gpcorrect("drift", model, training, days[1], "--json")
    assert after.json["scores"] == alone.json["scores"]
    assert "training.csv: left out" in after.said
    assert_refused(gpcorrect("drift", model, training), "all of these recordings made the model")


def test_update_refuses_what_was_learned(gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path) -> None:
    """Neither the fit's recording nor an update's is counted twice, alone or beside a new one, whatever is forced."""
    training = written(small_log(), tmp_path / "training.csv")
    new = tmp_path / "new.gpc"
    assert_refused(gpcorrect("update", model, training, "--output", new, "--force"), "made from this recording", "fit")
    assert_refused(gpcorrect("update", model, days[0], training, "--output", new), "made from 1 of these 2 recordings")
    assert not new.exists()
    assert gpcorrect("update", model, days[0], "--output", new, "--force").code == 0
    before = new.read_bytes()
    assert_refused(gpcorrect("update", new, days[0]), "made from this recording")
    assert new.read_bytes() == before


def test_explore_writes_a_table(gpcorrect: CommandLine, model: Path, tmp_path: Path) -> None:
    """A CSV of as many rows as asked, with pose and twist; JSON holds the same."""
    result = gpcorrect("explore", model, "--n", 4, "--output", tmp_path / "next.csv")
    assert result.code == 0, result.err
    lines = (tmp_path / "next.csv").read_text().splitlines()
    assert lines[0] == "x,y,z,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz,remaining"
    assert len(lines) == 5
    assert len(gpcorrect("explore", model, "--n", 4, "--json").json["proposals"]) == 4


def test_bad_input_is_refused(gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path) -> None:
    """No model, no number of proposals, ages that do not match, a folder that is not there: exit status 2."""
    assert_refused(gpcorrect("update", tmp_path / "none.gpc", days[0]), "no model file")
    assert_refused(gpcorrect("explore", model, "--n", 0), "between 1 and")
    assert_refused(gpcorrect("drift", model, *days, "--age", 1), "one --age a log")
    assert_refused(gpcorrect("drift", model, *days, "--false-alarms", 0.5), "more than 1")
    assert_refused(gpcorrect("drift", model, *days, "--report", tmp_path / "no" / "d.html"), "no")
    assert_refused(gpcorrect("drift", model, *days, "--plot", tmp_path / "d.png"), "--report instead of --plot")


def test_drift_refuses_copies_and_ages_out_of_order(
    gpcorrect: CommandLine, model: Path, days: list[Path], tmp_path: Path
) -> None:
    """A recording that comes twice counted twice, and ages that fall made a line of another order."""
    copy = tmp_path / "copy.csv"
    copy.write_bytes(days[0].read_bytes())
    assert_refused(gpcorrect("drift", model, days[0], copy), "copy.csv", "the same recording", "day0.csv")
    assert_refused(gpcorrect("drift", model, *days, "--age", 9, "--age", 3), "9.0, 3.0", "oldest first")
    assert gpcorrect("drift", model, *days, "--age", 3, "--age", 3).code == 0


def test_explore_refuses_a_task_that_was_misread(gpcorrect: CommandLine, model: Path, tmp_path: Path) -> None:
    """A recording of the task is looked at as every other is: a mirrored one shows another region."""
    log = small_log()
    seen = PoseSignal(log.tracker_cp.position * [1, 1, -1], log.tracker_cp.quaternion)
    mirrored = written(replace(log, tracker_cp=seen), tmp_path / "mirrored.csv")
    assert_refused(gpcorrect("explore", model, "--n", 2, "--task", mirrored), "mirrored.csv", "mirror image")
    for task in (tmp_path / "none.csv", tmp_path, written(log, tmp_path / "l.csv").with_suffix(".toml")):
        assert_refused(gpcorrect("explore", model, "--n", 2, "--task", task), task.name)
    assert_refused(gpcorrect("explore", model, "--columns", tmp_path / "map.toml"), "--task")


def test_recordings_of_another_arm_teach_nothing(gpcorrect: CommandLine, model: Path, tmp_path: Path) -> None:
    """A model of PSM1 is not updated with what PSM2 did, and says so where it is measured on it."""
    corrector, log = load(model), small_log(1)
    save(replace(corrector, summary={**corrector.summary, "arm": "left"}), tmp_path / "left.gpc")
    before = (tmp_path / "left.gpc").read_bytes()
    other = written(replace(log, meta=replace(log.meta, arm="right")), tmp_path / "right.csv")
    words = "the model was learned on left, and this recording is of right"
    assert_refused(gpcorrect("update", tmp_path / "left.gpc", other, "--force"), words)
    assert (tmp_path / "left.gpc").read_bytes() == before
    for measuring in ("evaluate", "drift"):
        assert words in gpcorrect(measuring, tmp_path / "left.gpc", other).err.replace("\n", " ")
