"""The pages of a fit and of an evaluation, of any task: how well the model holds, where, and what was dropped."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gpcorrect.calibration import Evaluation, Experiment, part_errors
from gpcorrect.report.aggregates import coverage_chart, errors_section, intervals_section, map_chart
from gpcorrect.report.page import Page, Section, write_page
from gpcorrect.report.paths import Shown
from gpcorrect.report.recordings import clocks_section, dropped_section, registration_sections
from gpcorrect.report.tasks import method_words
from gpcorrect.report.trajectories import trajectories_section, typical_trajectory
from gpcorrect.types import CalibrationLog

MOST_PARTS = 3
"""That the first sentence names; chosen by hand."""


def write_fit_report(experiment: Experiment, path: Path) -> None:
    """Write the self-contained page of an experiment.

    Parameters
    ----------
    experiment : Experiment
    path : Path
        HTML file.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    fit, evaluation, test = experiment.fit, experiment.evaluation, experiment.test
    sections: list[Section] = []
    verdict = "Fitted; nothing was held out, so nothing is known of its error on new trajectories."
    held_out, chosen = "nothing", ""
    if evaluation is not None and test is not None:
        verdict = f"Mean error on held-out trajectories: {_verdict(evaluation)}."
        held_out = f"{experiment.n_test} samples that pass cleaning, {len(test.trajectory_ids)} whole trajectories"
        chosen = "" if test.static else str(typical_trajectory(evaluation.clean))
        sections = [*_measured(evaluation, test, (fit.log, fit.cleaning))]
    sections += [*registration_sections(fit), clocks_section(fit.clocks)]
    if evaluation is not None and test is not None:
        sections.append(dropped_section("Dropped from the held-out recording", test, evaluation.cleaning))
    sections.append(dropped_section("Dropped from the training recording", fit.log, fit.cleaning))
    summary: Any = experiment.corrector.summary
    facts = [
        ("recording", summary["data"]["source"]),
        ("trained on", f"{fit.n_train} samples of {summary['fit']['n_trajectories']} trajectories"),
        ("held out", held_out),
        ("features", ", ".join(summary["features"])),
        ("time", f"{experiment.seconds:.1f} s, seed {summary['fit']['seed']}"),
        *(("note", remark) for remark in fit.remarks),
        *(("caution", caution) for caution in (evaluation.cautions if evaluation else ())),
    ]
    sources = model_sources("model", experiment.corrector)
    write_page(Page(_title("fit", experiment.corrector), verdict, facts, sections, sources, chosen), path)


def write_evaluation_report(
    evaluation: Evaluation, log: CalibrationLog, path: Path, notes: Sequence[str] = (), name: str = "model"
) -> None:
    """Write the self-contained page of a model measured on recordings.

    Parameters
    ----------
    evaluation : Evaluation
    log : CalibrationLog
        That was measured.
    path : Path
        HTML file.
    notes : sequence of str
        What the command noticed.
    name : str
        Of the model.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    corrector, clean = evaluation.corrector, evaluation.clean
    facts = [
        ("model", name),
        ("recording", log.name),
        ("measured on", f"{len(clean.rows)} samples that pass cleaning, of {len(log)}"),
        *(("note", note) for note in notes),
        *(("caution", caution) for caution in evaluation.cautions),
    ]
    sections = [*_measured(evaluation, log, None), dropped_section("Rejected samples", log, evaluation.cleaning)]
    sources = [*model_sources(name, corrector), *recording_sources(log)]
    chosen = "" if log.static else str(typical_trajectory(clean))
    verdict = f"Mean error: {_verdict(evaluation)}."
    write_page(Page(_title("evaluate", corrector), verdict, facts, sections, sources, chosen), path)


def _measured(evaluation: Evaluation, log: CalibrationLog, training: Any) -> list[Section]:
    """Return what was measured; `training` is the training's log and cleaning, where they are known."""
    measured, corrector = evaluation.clean, evaluation.corrector
    shown = Shown(corrector, measured, evaluation.cleaning, log)
    sections = [trajectories_section(shown), errors_section(shown, evaluation.dirty), intervals_section(shown)]
    if log.tracker_cp is not None and measured.raw.shape[1] in (3, 6) and corrector.TASK != "joints":
        position = log.tracker_cp.position[measured.rows]
        charts = [map_chart(shown, position)]
        if training is not None:
            train, cleaning = training
            charts.append(coverage_chart(train.tracker_cp.position[cleaning.keep], position, measured.in_domain))
        sections.insert(2, Section("Where in the workspace", (), (), charts))
    return sections


def _title(what: str, corrector: Any) -> str:
    room = {"pose": "", "joints": "joint ", "tool_position": "vision "}[corrector.TASK]
    return f"gpcorrect {room}{what}"


def _verdict(evaluation: Evaluation) -> str:
    first, *_, last = evaluation.corrector.METHODS
    rows = {(row.part, row.method): row for row in part_errors(evaluation.corrector, evaluation.clean)}
    parts = list(dict.fromkeys(part for part, _ in rows))
    words = [
        f"{part} {rows[part, first].mean:.3g} {rows[part, first].unit} {method_words(first)}, "
        f"{rows[part, last].mean:.3g} {rows[part, last].unit} {method_words(last)}"
        for part in parts[:MOST_PARTS]
    ]
    return "; ".join(words) + (f"; {len(parts) - MOST_PARTS} more below" if len(parts) > MOST_PARTS else "")


def model_sources(name: str, corrector: Any) -> list[tuple[str, str]]:
    """Return what a model remembers of its making, for the foot of a page.

    Parameters
    ----------
    name : str
        Of the model.
    corrector : Corrector
    """
    return [
        (
            f"{name}, {step.what}",
            f"{step.date}, {step.source}, SHA-256 {step.sha256 or 'none: not a file'}: {step.command}",
        )
        for step in corrector.history
    ]


def recording_sources(log: CalibrationLog) -> list[tuple[str, str]]:
    """Return the digests of a recording's files, for the foot of a page.

    Parameters
    ----------
    log : CalibrationLog
    """
    return [("recording", f"{log.name}, SHA-256 {digest}") for digest in log.recordings or (log.digest,) if digest]
