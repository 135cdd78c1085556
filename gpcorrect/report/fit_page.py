"""The page of `gpcorrect fit --report`: what was learned, how well it holds, what was dropped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect import plots
from gpcorrect.atomic import atomic_path
from gpcorrect.cleaning import CleaningReport
from gpcorrect.experiment import COMPONENTS, METHODS, Evaluation, Experiment, Measured
from gpcorrect.metrics import ErrorTable
from gpcorrect.plots.style import LABELS
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect.types import CalibrationLog

__all__ = ["write_fit_report"]

LEAVES = ("mean", "sd", "rmse", "p95", "max")
UNITS = {"position_mm": "mm", "rotation_deg": "deg"}


def write_fit_report(experiment: Experiment, path: Path) -> None:
    """Write the self-contained page of an experiment, and its first picture beside it as `overview.png`.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    write_page(_page(experiment), path)
    if experiment.evaluation is not None and experiment.test is not None:
        with atomic_path(path.with_name("overview.png")) as picture:
            picture.write_bytes(plots.png(plots.overview(experiment.evaluation.clean, experiment.test)))


def _page(experiment: Experiment) -> Page:
    sections = [_registration(experiment), _clocks(experiment)]
    measured, test = experiment.evaluation, experiment.test
    if measured is not None and test is not None:
        sections = [
            _overview(measured.clean, test),
            _errors(measured),
            _trajectory(measured.clean, test),
            _workspace(experiment, measured.clean, test),
            _intervals(measured.clean),
            *sections,
            _dropped("Dropped from the held-out recording", test, measured.cleaning),
        ]
    sections.append(_dropped("Dropped from the training recording", experiment.fit.log, experiment.fit.cleaning))
    return Page("gpcorrect fit", _verdict(experiment), _facts(experiment), sections)


def _verdict(experiment: Experiment) -> str:
    if experiment.evaluation is None:
        return "Fitted; nothing was held out, so nothing is known of its error on new trajectories."
    errors = experiment.evaluation.clean.errors()
    after, before = errors["corrected"], errors["raw"]
    parts = [("position", "position_mm", "mm"), ("rotation", "rotation_deg", "deg")]
    said = [
        f"{name} {_mean(before, key):.2f} {unit} before, {_mean(after, key):.2f} {unit} corrected"
        for name, key, unit in parts
        if key in after
    ]
    return f"Mean error on held-out trajectories: {'; '.join(said)}."


def _mean(table: ErrorTable, part: str) -> float:
    return table[part]["norm"]["mean"]


def _facts(experiment: Experiment) -> list[tuple[str, str]]:
    summary: Any = experiment.fit.summary
    return [
        (
            "recording",
            f"{summary['data']['source']} (SHA-256 {summary['data']['sha256'][:16] or 'not a file'})",
        ),
        (
            "trained on",
            f"{experiment.fit.n_train} samples of {summary['fit']['n_trajectories']} trajectories",
        ),
        ("held out", _held_out(experiment)),
        ("features", ", ".join(summary["features"])),
        ("time", f"{experiment.seconds:.1f} s, seed {summary['fit']['seed']}"),
        *(("note", remark) for remark in experiment.fit.remarks),
    ]


def _held_out(experiment: Experiment) -> str:
    if experiment.evaluation is None or experiment.test is None:
        return "nothing"
    count = len(experiment.evaluation.clean.rows)
    return f"{count} samples that pass cleaning, {len(experiment.test.trajectory_ids)} whole trajectories"


def _overview(measured: Measured, test: CalibrationLog) -> Section:
    caption = (
        "The held-out trajectory with the median error, and the errors of all held-out samples that pass cleaning."
    )
    return Section("In one picture", (), (), (FigureImage(plots.png(plots.overview(measured, test)), caption),))


def _errors(measured: Evaluation) -> Section:
    clean, dirty = measured.clean.errors(), measured.dirty.errors()
    parts = list(clean["raw"])
    tables = [
        *(
            TableData(*_summary_rows(clean, p), f"Samples that pass cleaning: length of the error [{UNITS[p]}].")
            for p in parts
        ),
        *(
            TableData(*_summary_rows(dirty, p), f"All samples, the tracker's faults included [{UNITS[p]}].")
            for p in parts
        ),
        *(
            TableData(
                *_axis_rows(clean, part),
                f"Per axis of the base frame, mean absolute error and SD [{UNITS[part]}].",
            )
            for part in clean["raw"]
        ),
    ]
    figures = [
        FigureImage(
            plots.png(plots.error_distribution(measured.clean)),
            "Share of held-out samples with an error below the value on the axis.",
        ),
        FigureImage(
            plots.png(plots.error_by_speed(measured.clean)),
            "Error by the speed of the observed pose: median, and the band up to the 90th percentile.",
        ),
    ]
    words = [
        "Errors are commands that would have been given for the observed poses, minus the commands that were given."
    ]
    return Section("Error on held-out trajectories", words, tables, figures)


def _summary_rows(errors: dict[str, ErrorTable], part: str) -> tuple[list[str], list[list[str]]]:
    rows = [[LABELS[m], *(f"{errors[m][part]['norm'][leaf]:.3f}" for leaf in LEAVES)] for m in METHODS]
    return ["", *(leaf if leaf != "sd" else "SD" for leaf in LEAVES)], rows


def _axis_rows(errors: dict[str, ErrorTable], part: str) -> tuple[list[str], list[list[str]]]:
    axes = ("x", "y", "z", "norm")
    rows = [
        [LABELS[m], *(f"{errors[m][part][a]['mean']:.3f} ± {errors[m][part][a]['sd']:.3f}" for a in axes)]
        for m in METHODS
    ]
    return ["", *axes], rows


def _trajectory(measured: Measured, test: CalibrationLog) -> Section:
    number = plots.typical_trajectory(measured, test)
    figures = [
        FigureImage(
            plots.png(plots.trajectory_paths(measured, test, number)),
            "What each method would have commanded, and what was commanded.",
        ),
        FigureImage(
            plots.png(plots.trajectory_errors(measured, test, number)),
            "Error of the corrected command inside its 95 % interval.",
        ),
    ]
    return Section(f"A typical held-out trajectory (number {number}: median error)", (), (), figures)


def _workspace(experiment: Experiment, measured: Measured, test: CalibrationLog) -> Section:
    assert test.tracker_cp is not None
    assert experiment.fit.log.tracker_cp is not None
    position = test.tracker_cp.position[measured.rows]
    train = experiment.fit.log.tracker_cp.position[experiment.fit.cleaning.keep]
    share = 100 * float(measured.in_domain.mean())
    figures = [
        FigureImage(
            plots.png(plots.residual_maps(measured, position)),
            "Length of the position error where the tool was.",
        ),
        FigureImage(
            plots.png(plots.workspace_coverage(train, position, measured.in_domain)),
            "Where the training was, and the held-out samples near it and outside.",
        ),
    ]
    return Section(
        "Where in the workspace",
        [f"{share:.1f} % of the held-out samples lie near training data."],
        (),
        figures,
    )


def _intervals(measured: Measured) -> Section:
    shares = measured.coverage95
    rows = [["observed", *(f"{100 * s:.1f} %" if np.isfinite(s) else "-" for s in shares)]]
    table = TableData(["95 % interval", *COMPONENTS], rows)
    figure = FigureImage(
        plots.png(plots.reliability(measured)),
        "Observed against nominal coverage; on the diagonal the intervals are honest.",
    )
    return Section("Are the intervals honest?", (), (table,), (figure,))


def _registration(experiment: Experiment) -> Section:
    chosen = experiment.fit.registration
    rows = [
        [
            c.kind,
            f"{c.position_mm:.3f}",
            f"{c.rotation_deg:.3f}",
            c.refused or ("chosen" if c.kind == chosen.model.kind else ""),
        ]
        for c in chosen.candidates
    ]
    table = TableData(
        ["model", "position [mm]", "rotation [deg]", ""],
        rows,
        "Median errors on left-out training trajectories.",
    )
    return Section(
        "Registration of the frames",
        [f"{chosen.reason[:1].upper()}{chosen.reason[1:]}."],
        (table,) if rows else (),
    )


def _clocks(experiment: Experiment) -> Section:
    clocks = experiment.fit.clocks
    offset, words = clocks.offset, [f"{clocks.remark[:1].upper()}{clocks.remark[1:].rstrip('.')}."]
    if offset is None or offset.lags.size == 0:
        return Section("Clocks", words)
    figure = FigureImage(
        plots.png(plots.offset_curve(offset)),
        "Agreement of the speeds of tracker and command over time offsets.",
    )
    return Section("Clocks", words, (), (figure,))


def _dropped(title: str, log: CalibrationLog, report: CleaningReport) -> Section:
    kept = int(report.keep.sum())
    words = [
        f"{kept} of {len(log)} samples were kept. "
        "Every dropped sample stands in cleaning.csv with the value and the limit that it broke."
    ]
    if kept == len(log):
        return Section(title, words)
    return Section(
        title,
        words,
        (),
        (FigureImage(plots.png(plots.dropped_samples(log, report)), "Dropped samples by reason."),),
    )
