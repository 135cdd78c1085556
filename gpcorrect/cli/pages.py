"""Report pages of commands that measure a model, and the list of rejected samples beside them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpcorrect.atomic import atomic_path

if TYPE_CHECKING:
    from gpcorrect.calibration import Evaluation, Experiment
    from gpcorrect.cleaning import CleaningReport
    from gpcorrect.types import CalibrationLog


def digests(*paths: Path) -> list[tuple[str, str]]:
    """Return names and SHA-256 of files and folders, for the foot of a page.

    Parameters
    ----------
    *paths : Path
        Files, or folders of pictures.
    """
    from gpcorrect.logs.reader import recording_digest

    return [("file", f"{path}, SHA-256 {recording_digest(path)}") for path in paths]


def write_fit_page(experiment: Experiment, page: Path) -> None:
    """Write the page of an experiment of any task, and cleaning.csv.

    Parameters
    ----------
    experiment : Experiment
    page : Path
        HTML file.
    """
    from gpcorrect.report import write_fit_report  # the report's libraries are an extra

    write_fit_report(experiment, page)
    reports = {"train": experiment.fit.cleaning}
    if experiment.evaluation is not None:
        reports["held out"] = experiment.evaluation.cleaning
    _write_dropped(reports, page)


def write_evaluation_page(
    evaluation: Evaluation, log: CalibrationLog, model: Path, notes: Sequence[str], page: Path
) -> None:
    """Write the page of a model measured on recordings, and cleaning.csv.

    Parameters
    ----------
    evaluation : Evaluation
    log : CalibrationLog
        That was measured.
    model : Path
        Its file.
    notes : sequence of str
        What the command noticed.
    page : Path
        HTML file.
    """
    from gpcorrect.report import write_evaluation_report

    write_evaluation_report(evaluation, log, page, notes, model.name)
    _write_dropped({"measured": evaluation.cleaning}, page)


def _write_dropped(reports: Mapping[str, CleaningReport], page: Path) -> None:
    rows: list[dict[str, Any]] = [{"set": name, **row} for name, report in reports.items() for row in report.to_table()]
    with atomic_path(page.with_name("cleaning.csv")) as path, path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else ["set"])
        writer.writeheader()
        writer.writerows(rows)
