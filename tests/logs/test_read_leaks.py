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
from gpcorrect.logs import read_log, write_log
from gpcorrect.types import PoseSignal


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


def test_measuring_on_the_training_is_said(recordings: list[Path]) -> None:
    """A model says when it has learned from what it is measured on; held-out parts of its own log are no such thing."""
    monday, tuesday, copy = recordings
    settings = FitSettings(method="offset", time_offset="none", clean=False)
    corrector = fit_model(read_logs([monday]), settings, task=JointCorrector).corrector
    for files, count in (([copy], 1), ([copy, tuesday], 1), ([tuesday], 0)):
        cautions = evaluate_model(corrector, read_logs(files)).cautions
        assert sum("was made from" in caution for caution in cautions) == count
    experiment = run_experiment(read_logs([monday, tuesday]), settings, task=JointCorrector)
    assert experiment.evaluation is not None
    assert not any("was made from" in caution for caution in experiment.evaluation.cautions)


def test_the_tracker_of_another_motion_is_refused(tmp_path: Path) -> None:
    """Poses that a tracker saw of something else are not learned from; joints of the same log are."""
    log, file = clean_log(), tmp_path / "log.csv"
    assert log.tracker_cp is not None
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
