"""The page of `gpcorrect compare`: two models on the same samples, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpcorrect.calibration import SideBySide, part_errors
from gpcorrect.report.aggregates import distribution_chart
from gpcorrect.report.charts import Mark, Role
from gpcorrect.report.fit_page import model_sources, recording_sources
from gpcorrect.report.page import Page, Section, TableData, write_page
from gpcorrect.report.paths import Line, Shown, path_charts
from gpcorrect.report.recordings import dropped_section
from gpcorrect.report.tasks import method_words, words_of
from gpcorrect.report.trajectories import inside95, listed, typical_trajectory

ROLES = (Role.RAW, Role.CORRECTED)


def write_compare_report(both: SideBySide, names: tuple[str, str], notes: Sequence[str], path: Path) -> None:
    """Write the self-contained page of two models on one recording.

    Parameters
    ----------
    both : SideBySide
    names : (str, str)
        Of the models.
    notes : sequence of str
        What the command noticed.
    path : Path
        HTML file.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    one, other = both.evaluations
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
    sections = [
        _overall(both, names),
        _trajectories(both, names, shown),
        dropped_section("Rejected", both.log, cleaning),
    ]
    sources = [
        *model_sources(names[0], one.corrector),
        *model_sources(names[1], other.corrector),
        *recording_sources(both.log),
    ]
    chosen = "" if both.log.static else str(typical_trajectory(both.measured[1]))
    write_page(Page("gpcorrect compare", f"Mean error, {words[0]}.", facts, sections, sources, chosen), path)


def _overall(both: SideBySide, names: tuple[str, str]) -> Section:
    rows = []
    for name, e, m in zip(names, both.evaluations, both.measured, strict=True):
        last = e.corrector.METHODS[2]
        certain = (f"{100 * replace(e, clean=m).coverage95:.1f} %", f"{100 * m.in_domain.mean():.1f} %")
        for r in part_errors(e.corrector, m):
            leaves = [f"{value:.3f}" for value in (r.mean, r.sd, r.rmse, r.p95, r.max)]
            more = certain if r.method == last else ("", "")
            rows.append([name, f"{r.part}, {method_words(r.method)}", *leaves, r.unit, *more])
    head = ["model", "error", "mean", "SD", "rmse", "p95", "max", "unit", "inside 95 %", "in domain"]
    table = TableData(head, rows, "On the samples that pass the cleaning of both models.", text=(1,))
    sizes = [
        (f"{p.name} error [{p.unit}]", {n: p.sizes(m.corrected) for n, m in zip(names, both.measured, strict=True)})
        for p in both.parts
    ]
    return Section("Overall", (), (table,), (distribution_chart(sizes, ROLES),))


def _trajectories(both: SideBySide, names: tuple[str, str], shown: Shown) -> Section:
    words = words_of(shown.corrector)
    roles = list(zip(names, ROLES, both.measured, strict=True))
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
