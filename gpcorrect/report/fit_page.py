"""The page of `gpcorrect fit --report`: what was learned, how well it holds, what was dropped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect import plots
from gpcorrect.atomic import atomic_path
from gpcorrect.calibration import COMPONENTS, METHODS, ErrorTable, Evaluation, Experiment, Measured
from gpcorrect.cleaning import CleaningReport
from gpcorrect.plots.style import LABELS, png
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect.types import CalibrationLog

__all__ = ["write_fit_report"]

UNITS = {"position_mm": "mm", "rotation_deg": "deg"}
LEAVES = {"mean": "mean", "sd": "SD", "rmse": "rmse", "p95": "p95", "max": "max"}


def write_fit_report(experiment: Experiment, path: Path) -> None:
    """Write the self-contained page of an experiment, and its first picture beside it as `overview.png`.

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
    sections = [_registration(experiment), _clocks(experiment)]
    evaluation, test = experiment.evaluation, experiment.test
    if evaluation is None or test is None:
        verdict = "Fitted; nothing was held out, so nothing is known of its error on new trajectories."
        overview = held_out = None
    else:
        verdict = _verdict(evaluation)
        overview = png(plots.overview(evaluation.clean, test))
        held_out = (
            f"{len(evaluation.clean.rows)} samples that pass cleaning, {len(test.trajectory_ids)} whole trajectories"
        )
        caption = (
            "The held-out trajectory with the median error, and the errors of all held-out samples that pass cleaning."
        )
        sections = [
            Section("In one picture", (), (), (FigureImage(overview, caption),)),
            _errors(evaluation),
            _trajectory(evaluation.clean, test),
            _workspace(experiment, evaluation.clean, test),
            _intervals(evaluation.clean),
            *sections,
            _dropped("Dropped from the held-out recording", test, evaluation.cleaning),
        ]
    sections.append(_dropped("Dropped from the training recording", experiment.fit.log, experiment.fit.cleaning))
    summary: Any = experiment.corrector.summary
    data, fit = summary["data"], summary["fit"]
    facts = [
        ("recording", f"{data['source']} (SHA-256 {data['sha256'][:16] or 'not a file'})"),
        ("trained on", f"{experiment.fit.n_train} samples of {fit['n_trajectories']} trajectories"),
        ("held out", held_out or "nothing"),
        ("features", ", ".join(summary["features"])),
        ("time", f"{experiment.seconds:.1f} s, seed {fit['seed']}"),
        *(("note", remark) for remark in experiment.fit.remarks),
        *(("caution", caution) for caution in (evaluation.cautions if evaluation else ())),
    ]
    write_page(Page("gpcorrect fit", verdict, facts, sections), path)
    if overview is not None:
        with atomic_path(path.with_name("overview.png")) as picture:
            picture.write_bytes(overview)


def _verdict(evaluation: Evaluation) -> str:
    errors = evaluation.clean_errors
    parts = []
    for name, key, unit in (("position", "position_mm", "mm"), ("rotation", "rotation_deg", "deg")):
        if key in errors["corrected"]:
            before, after = (errors[method][key]["norm"]["mean"] for method in ("raw", "corrected"))
            parts.append(f"{name} {before:.2f} {unit} before, {after:.2f} {unit} corrected")
    return f"Mean error on held-out trajectories: {'; '.join(parts)}."


def _errors(evaluation: Evaluation) -> Section:
    clean, dirty = evaluation.clean_errors, evaluation.dirty_errors
    axes = ("x", "y", "z", "norm")

    def lengths(errors: dict[str, ErrorTable], part: str, note: str) -> TableData:
        rows = [[LABELS[m], *(f"{errors[m][part]['norm'][leaf]:.3f}" for leaf in LEAVES)] for m in METHODS]
        return TableData(["", *LEAVES.values()], rows, f"{note} [{UNITS[part]}].")

    def by_axis(part: str) -> TableData:
        rows = [
            [LABELS[m], *(f"{clean[m][part][a]['mean']:.3f} ± {clean[m][part][a]['sd']:.3f}" for a in axes)]
            for m in METHODS
        ]
        note = f"Per axis of the base frame, mean absolute error and SD [{UNITS[part]}]."
        return TableData(["", *axes], rows, note)

    tables = [
        *(lengths(clean, part, "Samples that pass cleaning: length of the error") for part in clean["raw"]),
        *(lengths(dirty, part, "All samples, the tracker's faults included") for part in clean["raw"]),
        *(by_axis(part) for part in clean["raw"]),
    ]
    figures = [
        FigureImage(
            png(plots.error_distribution(evaluation.clean)),
            "Fraction of held-out samples with an error below the value on the axis.",
        ),
        FigureImage(
            png(plots.error_by_speed(evaluation.clean)),
            "Error by the speed of the observed pose: median, and the band up to the 90th percentile.",
        ),
    ]
    words = [
        "Errors are commands that would have been given for the observed poses, minus the commands that were given."
    ]
    return Section("Error on held-out trajectories", words, tables, figures)


def _trajectory(measured: Measured, test: CalibrationLog) -> Section:
    number = plots.typical_trajectory(measured, test)
    figures = [
        FigureImage(
            png(plots.trajectory_paths(measured, test, number)),
            "What each method would have commanded, and what was commanded.",
        ),
        FigureImage(
            png(plots.trajectory_errors(measured, test, number)),
            "Error of the corrected command inside its 95 % interval.",
        ),
    ]
    return Section(f"A typical held-out trajectory (number {number}: median error)", (), (), figures)


def _workspace(experiment: Experiment, measured: Measured, test: CalibrationLog) -> Section:
    assert test.tracker_cp is not None
    assert experiment.fit.log.tracker_cp is not None
    position = test.tracker_cp.position[measured.rows]
    train = experiment.fit.log.tracker_cp.position[experiment.fit.cleaning.keep]
    figures = [
        FigureImage(png(plots.residual_maps(measured, position)), "Length of the position error where the tool was."),
        FigureImage(
            png(plots.workspace_coverage(train, position, measured.in_domain)),
            "Where the training was, and the held-out samples near it and outside.",
        ),
    ]
    near = f"{100 * float(measured.in_domain.mean()):.1f} % of the held-out samples lie near training data."
    return Section("Where in the workspace", [near], (), figures)


def _intervals(measured: Measured) -> Section:
    covered = [f"{100 * part:.1f} %" if np.isfinite(part) else "-" for part in measured.coverage95]
    caption = "Observed against nominal coverage; on the diagonal the intervals are honest."
    figure = FigureImage(png(plots.reliability(measured)), caption)
    table = TableData(["95 % interval", *COMPONENTS], [["observed", *covered]])
    return Section("Are the intervals honest?", (), (table,), (figure,))


def _registration(experiment: Experiment) -> Section:
    chosen = experiment.fit.registration
    rows = []
    for c in chosen.candidates:
        note = c.refused or ("chosen" if c.kind == chosen.model.kind else "")
        rows.append([c.kind, f"{c.position_mm:.3f}", f"{c.rotation_deg:.3f}", note])
    note = "Median errors on left-out training trajectories."
    table = TableData(["model", "position [mm]", "rotation [deg]", ""], rows, note)
    words = [f"{chosen.reason[:1].upper()}{chosen.reason[1:]}."]
    return Section("Registration of the frames", words, (table,) if rows else ())


def _clocks(experiment: Experiment) -> Section:
    clocks = experiment.fit.clocks
    offset, words = clocks.offset, [f"{clocks.remark[:1].upper()}{clocks.remark[1:].rstrip('.')}."]
    if offset is None or offset.lags.size == 0:
        return Section("Clocks", words)
    caption = "Agreement of the speeds of tracker and command over time offsets."
    return Section("Clocks", words, (), (FigureImage(png(plots.offset_curve(offset)), caption),))


def _dropped(title: str, log: CalibrationLog, report: CleaningReport) -> Section:
    passed = int(report.keep.sum())
    words = [
        f"{passed} of {len(log)} samples passed cleaning. "
        "Every dropped sample stands in cleaning.csv with the value and the limit that it broke."
    ]
    if passed == len(log):
        return Section(title, words)
    return Section(
        title, words, (), (FigureImage(png(plots.dropped_samples(log, report)), "Dropped samples by reason."),)
    )
