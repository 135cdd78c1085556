"""What must not be learned from or measured on: a recording twice, a model's own, the tracker of another motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from validate_support import clean_log

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model, run_experiment
from gpcorrect.cli.reading import read_logs
from gpcorrect.errors import LogError
from gpcorrect.logs import join_logs, read_log, refuse_misread, validate_log, write_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import PoseSignal

QUICK = FitSettings(method="offset", time_offset="none", clean=False)


@pytest.fixture
def recordings(tmp_path: Path) -> list[Path]:
    """Return two recordings, and the first again under another name."""
    log, files = clean_log(), [tmp_path / f"{name}.csv" for name in ("monday", "tuesday", "copy")]
    for file, rows in zip(files, (log.trajectory < 2, log.trajectory >= 2, log.trajectory < 2), strict=True):
        write_log(log.select(rows), file)
    return files


def test_the_same_recording_twice_is_refused(recordings: list[Path]) -> None:
    """A copy, whatever its name, would be held out and measured on as if it were new."""
    monday, tuesday, copy = recordings
    assert len(read_logs([monday, tuesday])) == len(clean_log())
    with pytest.raises(LogError, match="same recording"):
        read_logs([monday, tuesday, copy])


@pytest.mark.parametrize("kind", ["Parquet", "spreadsheet", "by number"])
def test_a_copy_in_another_format_is_the_same_recording(recordings: list[Path], tmp_path: Path, kind: str) -> None:
    """Converted, or written again by a program with other line ends and fewer digits: refused, and said of a model."""
    monday, copy = recordings[0], tmp_path / "other.csv"
    if kind == "Parquet":
        copy = tmp_path / "other.parquet"
        write_log(read_log(monday), copy)
    else:
        table = np.genfromtxt(monday, delimiter=",", names=True)
        lines = [",".join("" if np.isnan(v) else f"{v:.13g}" for v in row) for row in table]
        head = ",".join(table.dtype.names) if kind == "spreadsheet" else ",".join(table.dtype.names[::-1])
        lines = lines if kind == "spreadsheet" else [",".join(line.split(",")[::-1]) for line in lines]
        copy.write_text("\ufeff" + "\r\n".join([head, *lines]), encoding="utf-8")
    with pytest.raises(LogError, match="same recording"):
        read_logs([monday, copy])
    settings = FitSettings(method="offset", time_offset="none", clean=False)
    corrector = fit_model(read_logs([monday]), settings, task=JointCorrector).corrector
    assert "was made from" in evaluate_model(corrector, read_logs([copy])).cautions[0]


@pytest.mark.parametrize("kind", ["a part", "both in one", "fewer columns"])
def test_a_recording_that_holds_samples_of_another_is_refused(
    recordings: list[Path], tmp_path: Path, kind: str
) -> None:
    """Cut out, put together or with fewer signals: refused beside it, and said of a model that learned from it."""
    monday, tuesday, _ = recordings
    log, other = read_log(monday), tmp_path / "other.csv"
    if kind == "both in one":
        log = join_logs([log, read_log(tuesday)])
    write_log(log.select(log.trajectory > 0) if kind == "a part" else replace(log, setpoint_jp=None), other)
    with pytest.raises(LogError, match="holds samples that"):
        read_logs([monday, other])
    corrector = fit_model(read_logs([monday]), QUICK, task=JointCorrector).corrector
    assert "was made from samples" in evaluate_model(corrector, read_logs([other])).cautions[0]


def test_trajectories_that_come_twice_are_refused(tmp_path: Path) -> None:
    """One motion under two numbers would be learned from, and held out as if it were new."""
    log, file = clean_log(), tmp_path / "twice.csv"
    rows = np.tile(np.arange(len(log)), 2)
    later = np.arange(len(rows)) >= len(log)
    doubled = log.select(rows)
    doubled = replace(doubled, trajectory=doubled.trajectory + 9 * later, time=doubled.time + 1e4 * later, name="")
    write_log(doubled, file)
    with pytest.raises(LogError, match="samples of another one"):
        read_logs([file])
    experiment = run_experiment(doubled, QUICK, task=JointCorrector)
    assert any("learned from too" in caution for caution in experiment.evaluation.cautions)


def test_an_arm_that_rests_where_it_rested_before_is_no_copy(tmp_path: Path) -> None:
    """A sensor of few digits reads the same at rest; only what moves tells one recording from another."""
    log = clean_log()
    step, resting = 1e-4, (np.arange(len(log)) % 50) < 25
    coarse = np.round(np.where(resting[:, None], log.tracker_cp.position[:1], log.tracker_cp.position) / step) * step
    assert not validate_log(replace(log, tracker_cp=PoseSignal(coarse)), ["twice"]).findings


def test_a_robot_that_moves_before_it_is_told_to_is_refused() -> None:
    """Commands and reports that were exchanged would be learned from as each other."""
    log = debridement_log(1, reaches=4, faults=False)
    assert not validate_log(log, ["exchanged"]).findings
    swapped = replace(log, setpoint_cp=log.measured_cp, measured_cp=log.setpoint_cp)
    with pytest.raises(LogError, match="no robot moves before"):
        refuse_misread(swapped)


def test_measuring_on_the_training_is_said(recordings: list[Path]) -> None:
    """A model says when it has learned from what it is measured on; held-out parts of its own log are no such thing."""
    monday, tuesday, copy = recordings
    settings = FitSettings(method="offset", time_offset="none", clean=False)
    corrector = fit_model(read_logs([monday]), settings, task=JointCorrector).corrector
    for files, count in (([copy], 1), ([copy, tuesday], 1), ([tuesday], 0)):
        cautions = evaluate_model(corrector, read_logs(files)).cautions
        assert sum("was made from" in caution for caution in cautions) == count
    experiment = run_experiment(read_logs([monday, tuesday]), settings, task=JointCorrector)
    assert not any("was made from" in caution for caution in experiment.evaluation.cautions)


def test_the_tracker_of_another_motion_is_refused(tmp_path: Path) -> None:
    """Poses that a tracker saw of something else are not learned from; joints of the same log are."""
    log, file = clean_log(), tmp_path / "log.csv"
    other = np.random.default_rng(0).permutation(4)
    rows = np.concatenate([np.flatnonzero(log.trajectory == k)[::-1] for k in other])
    write_log(replace(log, tracker_cp=PoseSignal(log.tracker_cp.position[rows]), name=""), file)
    with pytest.raises(LogError, match="does not move as"):
        read_logs([file])
    read_logs([file], learned=("measured_jp", "external_jp"))


def test_what_validate_finds_is_repeated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An error that does not stop a fit, as degrees in joints that it does not look at, is said by it."""
    log, file = clean_log(), tmp_path / "log.csv"
    assert log.external_jp is not None
    write_log(replace(log, external_jp=np.rad2deg(log.external_jp)), file)
    read_logs([file])
    assert "external_jp" in capsys.readouterr().err
    with pytest.raises(LogError, match="external_jp"):
        read_logs([file], learned=("measured_jp", "external_jp"))
