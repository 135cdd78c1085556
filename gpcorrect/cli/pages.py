"""Report pages of commands that measure a model, and the list of rejected samples beside them."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpcorrect.atomic import atomic_path

if TYPE_CHECKING:
    from gpcorrect.calibration import Evaluation, Experiment
    from gpcorrect.cleaning import CleaningReport
    from gpcorrect.types import CalibrationLog


def digests(*paths: Path) -> list[tuple[str, str]]:
    """Return names and SHA-256 of files, for the foot of a page; of a folder, that of its files' digests.

    Parameters
    ----------
    *paths : Path
        Files, or folders of pictures.
    """
    found = []
    for path in paths:
        files = [file for file in sorted(path.iterdir()) if file.is_file()] if path.is_dir() else [path]
        whole = hashlib.sha256()
        for file in files:
            with file.open("rb") as opened:
                one = hashlib.file_digest(opened, "sha256")
            whole.update(one.digest())
        digest = one if len(files) == 1 and not path.is_dir() else whole
        found.append(("file", f"{path}, SHA-256 {digest.hexdigest()}"))
    return found


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
