"""Pages of models of any task: fitted, evaluated, compared and aged; how well they hold, where, what was dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.calibration import (
    Ageing,
    Detection,
    Evaluation,
    Experiment,
    FitResult,
    Measured,
    SideBySide,
    part_errors,
)
from gpcorrect.calibration.dataset import evenly_spread
from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.logs.sync import Clocks
from gpcorrect.report import aggregates
from gpcorrect.report.page import Chart, Mark, Page, Panel, Role, Section, Series, TableData, runs, write_page
from gpcorrect.report.paths import (
    LEAVES,
    METHOD_WORDS,
    Line,
    Shown,
    inside95,
    leaves,
    listed,
    path_charts,
    trajectories_section,
    typical_trajectory,
    words_of,
)
from gpcorrect.types import CalibrationLog, FloatArray

MOST_PARTS = 3  # that the first sentence names; chosen by hand
BAND = (2.5, 97.5)  # percentiles of the training's scores that are shaded: 95 % of them
COMPARED = (Role.RAW, Role.CORRECTED)  # of two models
MOST_POINTS = 2500  # of a path that stands above the rejected samples; chosen by hand


def write_fit_report(experiment: Experiment, path: Path) -> None:
    """Write the self-contained page of an experiment; raises as :func:`write_page`.

    Parameters
    ----------
    experiment : Experiment
    path : Path, HTML file
    """
    fit, evaluation, test = experiment.fit, experiment.evaluation, experiment.test
    sections: list[Section] = []
    verdict = "Fitted; nothing was held out, so nothing is known of its error on new trajectories."
    held_out, chosen = "nothing", ""
    if evaluation is not None and test is not None:
        verdict = f"Mean error on held-out trajectories: {_verdict(evaluation)}."
        held_out = f"{experiment.n_test} samples that pass cleaning, {len(test.trajectory_ids)} whole trajectories"
        shown = Shown(evaluation.corrector, evaluation.clean, evaluation.cleaning, test)
        chosen = typical_trajectory(shown.groups(), evaluation.clean)
        sections = _measured(shown, evaluation.dirty, (fit.log, fit.cleaning))
    sections += [*_registration_sections(fit), _clocks_section(fit.clocks)]
    if evaluation is not None and test is not None:
        sections.append(_dropped_section("Dropped from the held-out recording", test, evaluation.cleaning))
    sections.append(_dropped_section("Dropped from the training recording", fit.log, fit.cleaning))
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
    sources = _model_sources("model", experiment.corrector)
    write_page(Page(_title("fit", experiment.corrector), verdict, facts, sections, sources, chosen), path)


def write_evaluation_report(
    evaluation: Evaluation, log: CalibrationLog, path: Path, notes: Sequence[str] = (), name: str = "model"
) -> None:
    """Write the self-contained page of a model measured on recordings; raises as :func:`write_page`.

    Parameters
    ----------
    evaluation : Evaluation
    log : CalibrationLog, that was measured
    path : Path, HTML file
    notes : sequence of str, what the command noticed
    name : str, of the model
    """
    corrector, clean = evaluation.corrector, evaluation.clean
    facts = [
        ("model", name),
        ("recording", log.name),
        ("measured on", f"{len(clean.rows)} samples that pass cleaning, of {len(log)}"),
        *(("note", note) for note in notes),
        *(("caution", caution) for caution in evaluation.cautions),
    ]
    shown = Shown(corrector, clean, evaluation.cleaning, log)
    dropped = _dropped_section("Rejected samples", log, evaluation.cleaning)
    sections = [*_measured(shown, evaluation.dirty, None), dropped]
    sources = [*_model_sources(name, corrector), *_recording_sources(log)]
    chosen = typical_trajectory(shown.groups(), clean)
    verdict = f"Mean error: {_verdict(evaluation)}."
    write_page(Page(_title("evaluate", corrector), verdict, facts, sections, sources, chosen), path)


def _measured(shown: Shown, dirty: Measured, training: Any) -> list[Section]:
    """Return what was measured; `training` is the training's log and cleaning, where they are known."""
    corrector, measured, log = shown.corrector, shown.measured, shown.log
    sections = [
        trajectories_section(shown),
        aggregates.errors_section(shown, dirty),
        aggregates.intervals_section(shown),
    ]
    if log.tracker_cp is not None and measured.raw.shape[1] in (3, 6) and corrector.TASK != "joints":
        position = log.tracker_cp.position[measured.rows]
        charts = [aggregates.map_chart(shown, position)]
        if training is not None:
            train, cleaning = training
            known = train.tracker_cp.position[cleaning.keep]
            charts.append(aggregates.coverage_chart(known, position, measured.in_domain))
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
        f"{part} {rows[part, first].mean:.3g} {rows[part, first].unit} {METHOD_WORDS[first]}, "
        f"{rows[part, last].mean:.3g} {rows[part, last].unit} {METHOD_WORDS[last]}"
        for part in parts[:MOST_PARTS]
    ]
    return "; ".join(words) + (f"; {len(parts) - MOST_PARTS} more below" if len(parts) > MOST_PARTS else "")


def _model_sources(name: str, corrector: Any) -> list[tuple[str, str]]:
    """Return what a model remembers of its making, for the foot of a page."""
    sources = []
    for s in corrector.history:
        made = f"{s.date}, {s.source}, SHA-256 {s.sha256 or 'none: not a file'}: {s.command}"
        sources.append((f"{name}, {s.what}", made))
    return sources


def _recording_sources(log: CalibrationLog) -> list[tuple[str, str]]:
    """Return the digests of a recording's files, for the foot of a page."""
    return [("recording", f"{log.name}, SHA-256 {digest}") for digest in log.recordings or (log.digest,) if digest]


def write_compare_report(both: SideBySide, names: tuple[str, str], notes: Sequence[str], path: Path) -> None:
    """Write the self-contained page of two models on one recording; raises as :func:`write_page`.

    Parameters
    ----------
    both : SideBySide
    names : (str, str), of the models
    notes : sequence of str, what the command noticed
    path : Path, HTML file
    """
    one = both.evaluations[0]
    reasons = [np.asarray(e.cleaning.reason) for e in both.evaluations]
    cleaning = replace(one.cleaning, reason=np.where(reasons[0] != "", reasons[0], reasons[1]))
    shown = Shown(one.corrector, both.measured[0], cleaning, both.log)
    words = [d.sentence(names) for d in both.differences()]
    facts = [
        ("recording", both.log.name),
        ("measured on", f"{len(both.measured[0].rows)} samples that pass the cleaning of both, of {len(both.log)}"),
        *(("difference", sentence) for sentence in words[1:]),
        *(("note", note) for note in notes),
        *((f"caution, {name}", c) for name, e in zip(names, both.evaluations, strict=True) for c in e.cautions),
    ]
    dropped = _dropped_section("Rejected", both.log, cleaning)
    sections = [_overall(both, names), _both_trajectories(both, names, shown), dropped]
    made = [source for n, e in zip(names, both.evaluations, strict=True) for source in _model_sources(n, e.corrector)]
    sources = [*made, *_recording_sources(both.log)]
    chosen = typical_trajectory(shown.groups(), both.measured[1])
    write_page(Page("gpcorrect compare", f"Mean error, {words[0]}.", facts, sections, sources, chosen), path)


def _overall(both: SideBySide, names: tuple[str, str]) -> Section:
    rows = []
    for name, e, m in zip(names, both.evaluations, both.measured, strict=True):
        last = e.corrector.METHODS[2]
        certain = (f"{100 * m.share_held:.1f} %", f"{100 * m.in_domain.mean():.1f} %")
        for r in part_errors(e.corrector, m):
            more = certain if r.method == last else ("", "")
            rows.append([name, f"{r.part}, {METHOD_WORDS[r.method]}", *leaves(r), r.unit, *more])
    head = ["model", "error", *LEAVES, "unit", "inside 95 %", "in domain"]
    table = TableData(head, rows, "On the samples that pass the cleaning of both models.", text=(1,))
    sizes = [
        (f"{p.name} error [{p.unit}]", {n: p.sizes(m.corrected) for n, m in zip(names, both.measured, strict=True)})
        for p in both.parts
    ]
    return Section("Overall", (), (table,), (aggregates.distribution_chart(sizes, COMPARED),))


def _both_trajectories(both: SideBySide, names: tuple[str, str], shown: Shown) -> Section:
    words = words_of(shown.corrector)
    roles = list(zip(names, COMPARED, both.measured, strict=True))
    paths = [Line(name, Mark.LINE, role, m.corrected) for name, role, m in roles]
    errors = [Line(name, Mark.LINE, role, m.corrected, m.interval95, folded=True) for name, role, m in roles]
    charts = path_charts(shown, paths, errors)
    if both.log.static:
        return Section("Static poses", (words.errors,), (), charts)
    head = ["trajectory", "samples", *(f"{p.name} {name} [{p.unit}]" for p in both.parts for name in names)]
    head += [f"{what}, {name}" for what in ("inside 95 %", "in domain") for name in names]
    rows = []
    for key, index in shown.groups().items():
        means = [np.nanmean(p.sizes(m.corrected[index])) for p in both.parts for m in both.measured]
        inside = [inside95(m, index) for m in both.measured]
        near = [f"{100 * m.in_domain[index].mean():.0f} %" for m in both.measured]
        rows.append([key, str(len(index)), *(f"{mean:.3f}" for mean in means), *inside, *near])
    table = TableData(head, rows, "Mean length of the error of each part.", keys=list(shown.groups()))
    return Section("Trajectory by trajectory", (words.errors, listed(shown)), (table,), charts)


def write_drift_report(
    baseline: FloatArray, found: Detection, ageing: Ageing, names: Sequence[str], words: Sequence[str], path: Path
) -> None:
    """Write the self-contained page of a model that ages; raises as :func:`write_page`.

    Parameters
    ----------
    baseline : (m,) array, scores of left-out training trajectories
    found : Detection, scores and evidence of n trajectories, oldest first
    ageing : Ageing, with the score at which a model is worn out
    names : sequence of str, of each trajectory's recording
    words : sequence of str, what was found, the verdict first
    path : Path, HTML file
    """
    number = np.arange(1, len(found.scores) + 1)
    ends = np.array([0.5, len(number) + 0.5])
    low, high = (np.full(2, np.percentile(baseline, end)) for end in BAND)
    spans = [] if found.alarm is None else [(found.alarm + 0.5, len(number) + 0.5, "after the alarm")]
    scores = [
        Series("95 % of left-out training", Mark.BAND, Role.QUIET, ends, low, y2=high),
        Series("worn out", Mark.DASH, Role.RAW, ends, np.full(2, ageing.limit)),
        Series("trajectories", Mark.DOTS, Role.CORRECTED, number, found.scores, size=8.0, text=names),
    ]
    evidence = [
        Series("alarm", Mark.DASH, Role.RAW, ends, np.full(2, found.threshold)),
        Series("evidence", Mark.LINE, Role.CORRECTED, number, found.evidence),
    ]
    order, whole = "trajectory, in order of recording", (0.0, len(number) + 1.0)
    panels = [
        Panel(order, "error over its standard deviation", scores, spans=spans, x_range=whole, height=240),
        Panel(order, "evidence of drift", evidence, spans=spans, x_range=whole, log_y=True, height=200),
    ]
    chart = Chart("Scores, about 1 while the model holds, and the evidence that they grew.", panels, shared=True)
    write_page(Page("gpcorrect drift", words[0], (), [Section("Over time", words[1:], (), (chart,))]), path)


def _registration_sections(fit: FitResult) -> list[Section]:
    """Return how the rigid model was chosen; nothing for a task without one."""
    chosen = fit.registration
    if chosen is None:
        return []
    rows = []
    for c in chosen.candidates:
        note = c.refused or ("chosen" if c.kind == chosen.model.kind else "")
        rows.append([c.kind, f"{c.position_mm:.3f}", f"{c.rotation_deg:.3f}", note])
    note = "Median errors on left-out training trajectories."
    table = TableData(["model", "position [mm]", "rotation [deg]", ""], rows, note, text=(3,))
    words = [f"{chosen.reason[:1].upper()}{chosen.reason[1:].rstrip('.')}."]
    return [Section("Registration of the frames", words, (table,) if rows else ())]


def _clocks_section(clocks: Clocks) -> Section:
    """Return what was found of the outside sensor's clock."""
    offset, words = clocks.offset, [f"{clocks.remark[:1].upper()}{clocks.remark[1:].rstrip('.')}."]
    if offset is None or offset.lags.size == 0:
        return Section("Clocks", words)
    series = [Series("correlation", Mark.LINE, Role.INK, offset.lags, offset.correlation)]
    spans = []
    if offset.observable and np.isfinite(offset.ci95).all():
        spans = [(float(offset.ci95[0]), float(offset.ci95[1]), f"estimate {offset.offset:.4f} s, 95 % interval")]
    panel = Panel("time offset of the outside sensor [s]", "correlation of speeds", series, spans=spans, height=240)
    caption = "Agreement of the speeds of outside sensor and command over time offsets; shaded: the estimate."
    return Section("Clocks", words, (), (Chart(caption, [panel]),))


def _dropped_section(title: str, log: CalibrationLog, report: CleaningReport) -> Section:
    """Return which samples of a recording were rejected, over the recording, a row a reason."""
    reasons: Sequence[str] = [reason for reason, count in report.counts.items() if count]
    words = [f"{int(report.keep.sum())} of {len(log)} samples passed cleaning."]
    if not reasons:
        return Section(title, words)
    rows = [[reason, str(report.counts[reason]), Reason(reason).sentence] for reason in reasons]
    table = TableData(["reason", "samples", "what it means"], rows, text=(2,))
    marks = Panel("sample", "", [_rejected(report, reasons)], rows=reasons, x_range=(0, len(log)))
    caption = "Rejected samples by reason, in the order of the recording."
    return Section(title, words, (table,), (Chart(caption, [*_path(log), marks], shared=True),))


def _rejected(report: CleaningReport, reasons: Sequence[str]) -> Series:
    label = np.asarray(report.reason)
    found = [run for run in runs(label) if label[run[0]]]
    text = [f"samples {run[0]} to {run[-1]}: {label[run[0]]}" for run in found]
    row = [reasons.index(str(label[run[0]])) for run in found]
    first, last = [run[0] for run in found], [run[-1] + 1 for run in found]
    return Series("rejected", Mark.BARS, Role.DROPPED, first, row, x2=last, text=text)


def _path(log: CalibrationLog) -> list[Panel]:
    """Return the outside sensor's positions over the samples; nothing for recordings without any."""
    if log.tracker_cp is None:
        return []
    shown = evenly_spread(len(log), MOST_POINTS)
    series = [
        Series(axis, Mark.LINE, role, shown, 100 * log.tracker_cp.position[shown, i])
        for i, (axis, role) in enumerate(zip("xyz", (Role.CORRECTED, Role.GOOD, Role.RIGID), strict=True))
    ]
    return [Panel("sample", "observed [cm]", series, x_range=(0, len(log)))]
