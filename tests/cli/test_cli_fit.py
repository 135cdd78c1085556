"""`gpcorrect fit`, `evaluate`, `correct` through the front door."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, written
from support import Fitted, real_data, small_log

from gpcorrect.calibration import load
from gpcorrect.cli.console import certainty
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog, PoseSignal

# The marker is the tool tip and the clocks agree: looking for them takes longest, and other tests do it.
QUICK = ("--marker", "none", "--time-offset", "none")


def few_samples() -> CalibrationLog:
    """Return a recording that is fitted in seconds."""
    return small_log(trajectories=6, samples=40)


def test_fit_corrects_held_out_trajectories_and_says_so_in_json(fitted: Fitted) -> None:
    """The fields that other programs rely on are there, and the corrected error is less than a tenth of the raw one."""
    result = fitted.json
    assert {"n_train", "n_test", "dropped", "seconds", "errors", "errors_dirty", "coverage95"} <= set(result)
    raw, corrected = (result["errors"][m]["position_mm"]["norm"]["mean"] for m in ("raw", "corrected"))
    assert set(result["errors"]["raw"]["rotation_deg"]) == {"x", "y", "z", "norm"}
    assert set(result["errors"]["raw"]["rotation_deg"]["norm"]) == {"mean", "sd", "rmse", "p95", "max"}
    assert corrected < 0.1 * raw
    assert result["n_train"] + result["n_test"] + sum(result["dropped"].values()) == len(small_log())


def test_evaluate_repeats_what_fit_measured(gpcorrect: CommandLine, fitted: Fitted, tmp_path: Path) -> None:
    """A saved model measured on the held-out trajectories gives the errors that fit printed."""
    log = small_log()
    last = written(log.select(log.trajectory >= 13), tmp_path / "last.csv")
    again = gpcorrect("evaluate", fitted.model, last, "--time-offset", "none", "--json").json
    assert again["errors"]["corrected"]["position_mm"]["norm"]["rmse"] == pytest.approx(
        fitted.json["errors"]["corrected"]["position_mm"]["norm"]["rmse"], rel=1e-9
    )


def test_the_same_seed_gives_the_same_model(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Two fits of one log agree in every error and in what is dropped."""
    log = written(few_samples(), tmp_path / "log.csv")
    first, again = (gpcorrect("fit", log, "--output", tmp_path / "m.gpc", *QUICK, "--json").json for _ in range(2))
    assert again["errors"] == first["errors"]
    assert again["dropped"] == first["dropped"]


def test_the_model_says_by_how_much_the_tracker_was_shifted(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """The shift of the tracker's clock that was applied stands in the figures of the fit and in the model file."""
    log, model = written(few_samples(), tmp_path / "log.csv"), tmp_path / "m.gpc"
    shifted = ("--time-offset", 0.02, "--marker", "none", "--no-clean")
    result = gpcorrect("fit", log, "--output", model, *shifted, "--json").json
    assert result["model"]["fit"]["tracker_shift"] == 0.02
    assert load(model).info()["fit"]["tracker_shift"] == 0.02


def test_what_is_not_cleaned_away_is_not_said_to_be_dropped(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Without cleaning nothing is left out of the training, whatever the rules find."""
    log = few_samples()
    position = np.array(log.tracker_cp.position)
    position[30:60:7] += 0.2
    path = written(replace(log, tracker_cp=replace(log.tracker_cp, position=position)), tmp_path / "log.csv")
    command = ("fit", path, "--output", tmp_path / "m.gpc", "--method", "offset", *QUICK)
    assert sum(gpcorrect(*command, "--json").json["model"]["fit"]["dropped"].values()) >= 5
    result = gpcorrect(*command, "--no-clean", "--json").json
    assert result["model"]["fit"]["dropped"] == {}
    assert "dropped: none" in gpcorrect(*command, "--no-clean").out


def test_correct_asks_the_model_file(gpcorrect: CommandLine, fitted: Fitted) -> None:
    """The command for a desired pose lies within a millimetre of where the planted miss says."""
    log = small_log(noise=0.0)
    row = 30
    velocity = (log.tracker_cp.position[row + 1] - log.tracker_cp.position[row - 1]) / 0.04
    pose = [*log.tracker_cp.position[row], *log.tracker_cp.quaternion[row]]
    answer = gpcorrect("correct", fitted.model, "--pose", *pose, "--twist", *velocity, 0, 0, 0, "--json").json
    assert np.linalg.norm(np.array(answer["position"]) - log.setpoint_cp.position[row]) < 1e-3
    assert answer["status"] == "OK"
    assert answer["in_domain"]
    sent = [*answer["position"], *answer["quaternion"], "--twist", *velocity, 0, 0, 0]
    back = gpcorrect("correct", fitted.model, "--reached", "--json", "--pose", *sent).json
    assert np.linalg.norm(np.array(back["position"]) - pose[:3]) < 1e-3


def test_a_position_only_log_gives_position_errors_only(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Without a tracker's orientation no rotation error is invented, and the fit says what it leaves alone."""
    log = few_samples()
    bare = written(replace(log, tracker_cp=PoseSignal(log.tracker_cp.position)), tmp_path / "bare.csv")
    done = gpcorrect("fit", bare, "--output", tmp_path / "m.gpc", "--json").json
    assert set(done["errors"]["corrected"]) == {"position_mm"}
    answer = gpcorrect("correct", tmp_path / "m.gpc", "--position", 0.1, 0, -0.1, "--json").json
    assert answer["quaternion"] is None


def test_report_and_dropped_samples_are_written(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A block dropped by hand is listed sample by sample, and the page is whole and needs no other file."""
    log = written(few_samples(), tmp_path / "log.csv")
    words = ("--drop", "1:10.1:10.3", "--report", tmp_path / "report")
    gpcorrect("fit", log, "--output", tmp_path / "m.gpc", *QUICK, *words)
    page = (tmp_path / "report" / "report.html").read_text()
    assert page.count('class="chart"') >= 9
    assert "--drop 1:10.1:10.3" in page[page.index("<footer>") :]
    rows = list(csv.DictReader((tmp_path / "report" / "cleaning.csv").open()))
    dropped = [row for row in rows if row["reason"] == "manual"]
    assert len(dropped) == 11
    assert all(10.09 < float(row["time"]) < 10.31 for row in dropped)


@pytest.mark.slow
def test_the_real_recording_works_as_it_is(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """`gpcorrect fit dvrk_random.csv` lessens position and rotation error on the last trajectories."""
    result = gpcorrect("fit", real_data("dvrk_random.csv"), "--output", tmp_path / "m.gpc", "--json").json
    for part in ("position_mm", "rotation_deg"):
        raw, corrected = (result["errors"][m][part]["norm"]["rmse"] for m in ("raw", "corrected"))
        assert corrected < 0.85 * raw


def test_a_correction_that_does_not_help_is_said_to_be_none(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Where the miss is noise, learning cannot beat the registration, and the fit says so."""
    log, rng = few_samples(), np.random.default_rng(3)
    seen = log.setpoint_cp.position + 1e-3 * rng.standard_normal(log.setpoint_cp.position.shape)
    pure_noise = replace(log, tracker_cp=PoseSignal(seen, log.setpoint_cp.quaternion))
    path = written(pure_noise, tmp_path / "noise.csv")
    done = gpcorrect("fit", path, "--output", tmp_path / "m.gpc", *QUICK, "--json").json
    ratio = [done["errors"][m]["position_mm"]["norm"]["rmse"] for m in ("corrected", "rigid")]
    assert any("position" in caution for caution in done["cautions"]) == (ratio[0] >= ratio[1])
    assert ratio[0] > 0.95 * ratio[1]


def test_an_axis_whose_intervals_hold_too_few_is_named() -> None:
    """The mean over all axes hides one: an axis below 90 % stands beside it, and one that was not measured does not."""
    figures = {"coverage95": 0.96, "coverage95_dirty": 0.9, "in_domain": 1.0, "in_domain_dirty": 1.0}
    axes = {"x": 0.97, "y": 0.84, "z": 0.99, "rx": float("nan")}
    assert "cover 96.0 %, but 84 % along y (90.0 %" in certainty({**figures, "coverage95_axes": axes})
    assert "but" not in certainty({**figures, "coverage95_axes": {"x": 0.93}})


FEW, NARROW = "samples pass cleaning by the training's thresholds", "95 % intervals cover only"


@pytest.mark.parametrize(("moved", "said"), [(0.0, ()), (0.0006, (NARROW,)), (0.001, (FEW, NARROW))])
def test_figures_that_hold_for_few_samples_are_not_left_alone(
    gpcorrect: CommandLine, small_model: Path, tmp_path: Path, moved: float, said: tuple[str, ...]
) -> None:
    """A zero that moved by 0.6 mm on average breaks the intervals; by 1 mm, most samples do not pass as well."""
    log = small_log(seed=2, trajectories=8)
    shift = moved * np.array([1.0, -1.0, 1.0]) * (0.5 + log.trajectory[:, None] / 8)  # some trajectories still pass
    command = PoseSignal(log.setpoint_cp.position + shift, log.setpoint_cp.quaternion)
    write_log(replace(log, setpoint_cp=command), tmp_path / "moved.csv")
    result = gpcorrect("evaluate", small_model, tmp_path / "moved.csv")
    assert result.code == 0
    for sentence in (FEW, NARROW):
        assert (sentence in result.said) == (sentence in said)
    assert "of all samples)" in result.out


def between(log: CalibrationLog, every: int) -> CalibrationLog:
    """Return a log with as many rows for each sample of its tracker, whose cells are empty in all but the first."""
    rows = np.repeat(np.arange(len(log)), every)
    place = np.arange(len(rows)) % every
    fine = log.select(rows)
    assert fine.tracker_cp.quaternion is not None
    position, quaternion = (
        np.where(place[:, None] > 0, np.nan, part) for part in (fine.tracker_cp.position, fine.tracker_cp.quaternion)
    )
    return replace(fine, time=fine.time + 0.02 / every * place, tracker_cp=PoseSignal(position, quaternion))


@pytest.mark.parametrize("every", [3, 12])
def test_empty_cells_between_the_samples_of_a_tracker_cost_nothing(
    gpcorrect: CommandLine, tmp_path: Path, every: int
) -> None:
    """They are learned from and measured on as if they stood alone, where eleven rows of twelve are empty too."""
    log, errors = small_log(), []
    for number, recording in enumerate((log, between(log, every))):
        path, model = written(recording, tmp_path / f"{number}.csv"), tmp_path / f"{number}.gpc"
        done = gpcorrect("fit", path, "--output", model, "--json", "--time-offset", "none")
        assert done.code == 0, done.said
        again = gpcorrect("evaluate", model, path, "--json", "--time-offset", "none").json
        assert done.json["n_train"] > 700
        errors.append([found["errors"]["corrected"]["position_mm"]["norm"]["rmse"] for found in (done.json, again)])
    np.testing.assert_allclose(*errors, rtol=0.05)
