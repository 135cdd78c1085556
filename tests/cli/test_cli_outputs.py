"""No output takes the place of a file of another kind: recordings, models and hand-written files stay."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import CommandLine, assert_refused

from gpcorrect.atomic import require_own
from gpcorrect.calibration import CommandCorrector, save
from gpcorrect.cli.options import rejected_table
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log, write_log

OVER_A_LOG = (
    ("fit", "other.csv", "-o", "log.csv"),  # what a shell makes of: fit other.csv -o log*.csv
    ("joint", "fit", "log.csv", "-o", "log.csv"),
    ("joint", "rezero", "model.gpc", "other.csv", "-o", "log.csv"),
    ("update", "model.gpc", "other.csv", "-o", "log.csv"),
    ("explore", "model.gpc", "-o", "log.csv"),
    ("drift", "model.gpc", "other.csv", "--report", "notes.html"),
    ("simulate", "debridement", "--reaches", "2", "-o", "log.csv"),
    ("zigzag", "-o", "log.csv"),
    ("robot", "extract", "log.csv", "--every", "2", "-o", "log.csv"),
    ("vision", "fit", "log.csv", "-o", "log.csv"),
    ("vision", "board", "-o", "log.csv"),
    ("vision", "calibrate", "rig.toml", "-o", "rig.toml"),
    ("vision", "rig", ".", "-o", "rig.toml"),
    ("vision", "track", "front.mp4", "-o", "log.csv"),
    ("discrepancy", "run", "--machine", "raven2_calibration", "--log", "log.csv", "-o", "."),
    ("reproduce", "mahler2014", "-o", "."),
    ("fit", "log.csv", "-o", "new.gpc", "--report", "notes.html"),
    ("fit", "log.csv", "-o", "new.gpc", "--report", "."),  # where somebody's own report.html is
    ("joint", "fit", "log.csv", "-o", "new.gpc", "--report", "tables.html"),
    ("evaluate", "model.gpc", "other.csv", "--report", "tables.html"),
    ("explore", "model.gpc", "-o", "model.gpc"),
    ("convert", "log.csv", "map.parquet", "--columns", "map.toml"),
)


@pytest.mark.parametrize("words", OVER_A_LOG, ids=" ".join)
def test_a_command_never_replaces_a_file_of_another_kind(
    gpcorrect: CommandLine, log_file: Path, small_model: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    """Refused before the work, and every file is what it was."""
    folder = log_file.parent
    monkeypatch.chdir(folder)
    shutil.copy(log_file, "other.csv")
    shutil.copy(small_model, "model.gpc")
    for name in ("rig.toml", "map.toml", "notes.html", "report.html", "tables-cleaning.csv"):
        Path(name).write_text("[tracker_cp]  # by hand")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert_refused(gpcorrect(*words), "is there already")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("name", ["model.toml", "model.xml", "report.json"])
def test_a_run_replaces_files_of_its_own_runs_only(
    gpcorrect: CommandLine, log_file: Path, tmp_path: Path, name: str
) -> None:
    """A model by hand, of the name that the completed one gets, was replaced by it, or the run failed at its end."""
    output = tmp_path / "missing"
    output.mkdir()
    (output / name).write_text("by hand")
    words = ("discrepancy", "run", "--machine", "raven2_calibration", "--log", log_file, "-o", output)
    assert_refused(gpcorrect(*words), f"{name} is there already")
    assert list(output.iterdir()) == [output / name]


def test_sealed_labels_are_not_replaced(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Nor is a nominal model which is not the one that the cases are simulated with."""
    (tmp_path / "one.toml").write_text('arm = "joints"\njoints = [1]\njoint_types = "R"\n[noise]\n')
    (tmp_path / "spec.toml").write_text('model = "one.toml"\n[[cases]]\n')
    words = ("discrepancy", "generate", "--spec", tmp_path / "spec.toml", "-o")
    sealed, other = tmp_path / "blind" / "sealed", tmp_path / "other"
    sealed.mkdir(parents=True)
    assert_refused(gpcorrect(*words, sealed.parent), "sealed is there already")
    other.mkdir()
    (other / "nominal.toml").write_text('arm = "joints"\njoints = [1, 2]\njoint_types = "RR"\n')
    assert_refused(gpcorrect(*words, other), "nominal.toml is there already")


def test_an_annotated_video_is_none_of_those_that_are_tracked(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """It took the place of a camera's own recording, or became one more camera of a folder."""
    video = tmp_path / "front.mp4"
    video.write_bytes(b"recorded")
    for given, annotated in ((video, video), (tmp_path, tmp_path / "look.mp4")):
        words = ("vision", "track", given, "--annotated", annotated, "-o", tmp_path / "track.csv")
        assert_refused(gpcorrect(*words), "would be among the recordings")
    assert video.read_bytes() == b"recorded"


def test_a_model_and_its_page_are_two_files(gpcorrect: CommandLine, log_file: Path) -> None:
    """Of one name for both only the page was left, and the fit was gone."""
    both = log_file.parent / "both.html"
    for words in (("fit", log_file), ("joint", "fit", log_file)):
        assert_refused(gpcorrect(*words, "-o", both, "--report", both), "would both be")
    assert not both.exists()


def test_models_are_in_one_place(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """With a folder and an address the folder was changed, and the running servers, which were meant, were not."""
    both = ("--store", tmp_path, "--endpoint", "tcp/127.0.0.1:1")
    for words in (("list",), ("activate", "one"), ("rollback",)):
        assert_refused(gpcorrect("models", *words, *both), "both were named")


def test_each_page_has_a_table_of_its_own(tmp_path: Path) -> None:
    assert rejected_table(tmp_path / "report.html").name == "cleaning.csv"
    assert rejected_table(tmp_path / "monday.html").name == "monday-cleaning.csv"


def test_times_before_zero_are_part_of_a_recording(gpcorrect: CommandLine, log_file: Path, tmp_path: Path) -> None:
    """Taken out of a recording without a first second, they were left out without a word."""
    log = read_log(log_file)
    early = tmp_path / "early.csv"
    write_log(replace(log, time=log.time - log.time[-1]), early)
    gpcorrect("robot", "extract", early, "-o", tmp_path / "part.csv", "--json")
    assert len(read_log(tmp_path / "part.csv")) == len(log)
    words = ("robot", "extract", early, "-o", tmp_path / "none.csv", "--begin", 5)
    assert_refused(gpcorrect(*words), "no sample lies between 5 and inf s")


def test_a_model_is_saved_over_a_model_and_over_nothing_else(
    small_corrector: CommandCorrector, log_file: Path, tmp_path: Path
) -> None:
    """From Python too; an empty file holds nothing that could be lost."""
    target = tmp_path / "model.gpc"
    target.touch()
    for _ in range(2):
        save(small_corrector, target)
    with pytest.raises(GpCorrectError, match="no model file"):
        save(small_corrector, log_file)


def test_what_a_simulator_made_may_be_made_again(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A simulated recording is replaced; one that names no simulator stays."""
    target = tmp_path / "log.csv"
    words = ("simulate", "joints", "--machine", "raven2_calibration", "--trajectories", 1, "--seconds", 1, "--output")
    for seed in (1, 2):
        assert gpcorrect(*words, target, "--seed", seed).code == 0
    shutil.copy(target, tmp_path / "real.csv")
    assert_refused(gpcorrect(*words, tmp_path / "real.csv"), "not overwritten")


def test_a_sidecar_replaces_no_file_of_another_log(log_file: Path, tmp_path: Path) -> None:
    """`lab.toml`, which may be a mapping by hand, stays where `lab.csv` is not its log."""
    (tmp_path / "lab.toml").write_text("[tracker_cp]")
    with pytest.raises(GpCorrectError, match="is there already"):
        write_log(read_log(log_file), tmp_path / "lab.csv")
    assert (tmp_path / "lab.toml").read_text() == "[tracker_cp]"


def test_an_output_of_its_own_kind_is_replaced(tmp_path: Path) -> None:
    """The look before the work takes what begins as it should."""
    page = tmp_path / "page.html"
    page.write_text("\n<!DOCTYPE html>")
    require_own(page, rb"(?i)\s*<!doctype html", "page")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("debridement", "--seconds", 3), ("no --seconds", "joints")),
        (("debridement", "--sessions", 2, "--payload", 0.1), ("no --sessions and no --payload", "reaches or joints")),
        (("reaches", "--machine", "dvrk_psm", "--seconds", 20), ("no --seconds", "joints")),
        (("joints", "--machine", "raven2_calibration", "--clean"), ("no --clean", "debridement or reaches")),
        (("joints", "--machine", "raven2_calibration", "--position-only", "--clean"), ("no --position-only",)),
    ],
)
def test_a_task_refuses_options_of_other_tasks(
    gpcorrect: CommandLine, tmp_path: Path, words: tuple[object, ...], said: tuple[str, ...]
) -> None:
    """What a task would not heed is no option of it; the tasks that do are named."""
    assert_refused(gpcorrect("simulate", *words, "--output", tmp_path / "log.csv"), *said)
    assert not (tmp_path / "log.csv").exists()
