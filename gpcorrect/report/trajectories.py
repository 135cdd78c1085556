"""Measured trajectories one by one: a table that chooses, paths over time and in space, errors in their intervals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect.calibration import COMPONENTS, Corrector, JointCorrector, Measured, joint_units
from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.report.charts import Chart, Mark, Panel, Role, Series
from gpcorrect.report.page import Section, TableData
from gpcorrect.report.tasks import METHOD_ROLES, method_words, reference, words_of
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

__all__ = ["Shown", "rejected_spans", "trajectories_section"]

MOST_SAMPLES = 8000
"""Drawn on a page, so that it stays near two megabytes; chosen by hand."""
MOST_TRAJECTORIES = 300
"""In the table and the charts; the page names how many there are. Chosen by hand."""
DEGREES = float(np.rad2deg(1.0))
THREE = 3
"""Panels that are drawn above each other; more are drawn in two columns."""
WIDE_TABLE = 2
"""Parts up to which the table shows all three methods; chosen by hand."""


class Axis(NamedTuple):
    """A component of errors: its column, name and unit, and what one m or rad is in it."""

    column: int
    name: str
    unit: str
    scale: float

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]"


@dataclass(frozen=True, eq=False)
class Shown:
    """A measured recording as its page shows it.

    Parameters
    ----------
    corrector : Corrector
    measured : Measured
        Samples that pass cleaning.
    cleaning : CleaningReport
        Why the others do not.
    log : CalibrationLog
        All of them.
    """

    corrector: Corrector
    measured: Measured
    cleaning: CleaningReport
    log: CalibrationLog

    @property
    def axes(self) -> list[Axis]:
        """Components of errors that were measured."""
        if isinstance(self.corrector, JointCorrector):
            names, factors = joint_units(self.corrector.types)
            axes = [Axis(j, f"joint {j + 1}", names[j], float(factors[j])) for j in range(len(names))]
        else:
            axes = [Axis(i, n, *(("mm", 1e3) if i < 3 else ("deg", DEGREES))) for i, n in enumerate(COMPONENTS)]
        corrected = self.measured.corrected
        return [a for a in axes if a.column < corrected.shape[1] and np.isfinite(corrected[:, a.column]).any()]

    def groups(self) -> dict[str, IntArray]:
        """Return the measured samples of each trajectory, by its number; of static poses all together."""
        if self.log.static:
            return {"": np.arange(len(self.measured.rows))}
        numbers = self.measured.trajectory
        ids = [number for number in self.log.trajectory_ids.tolist() if number in set(numbers.tolist())]
        return {str(number): np.flatnonzero(numbers == number) for number in ids[:MOST_TRAJECTORIES]}


def trajectories_section(shown: Shown) -> Section:
    """Return the table of trajectories, and the charts of the one that is chosen in it.

    Parameters
    ----------
    shown : Shown
    """
    groups = shown.groups()
    step = -(-sum(map(len, groups.values())) // MOST_SAMPLES)
    rows = {key: _thinned(shown.measured.rows[rows], rows, step) for key, rows in groups.items()}
    thin = f" Every {step}th sample is drawn." if step > 1 else ""
    gaps = " Shaded: samples that cleaning rejected; lines have gaps there." if not shown.cleaning.keep.all() else ""
    words, panels = words_of(shown.corrector), {key: _panels(shown, index, key) for key, index in rows.items()}
    captions = (
        f"What was {words.reference}, {words.reached} and {words.answer}, in space. Drag to turn; dots mark the start.",
        f"The same over time.{gaps}{thin} Drag to zoom, double-click to go back.",
        f"Errors, and the 95 % interval around no error.{gaps}",
    )
    charts = [
        _chart(caption, {key: found[i] for key, found in panels.items()}, space=i == 0)
        for i, caption in enumerate(captions)
        if all(found[i] for found in panels.values())
    ]
    if shown.log.static:
        return Section("Static poses, in the order of the recording", (words.errors,), (), charts)
    total = len(np.unique(shown.measured.trajectory))
    more = f" The first {len(groups)} of {total} are listed." if total > len(groups) else ""
    hint = f"Choose a row to see that trajectory below; column names sort.{more}"
    return Section("Trajectory by trajectory", (words.errors, hint), (_table(shown, groups),), charts)


def _chart(caption: str, choices: Mapping[str, list[Panel]], *, space: bool) -> Chart:
    columns = 2 if len(next(iter(choices.values()))) > THREE else 1
    if "" in choices:
        return Chart(caption, panels=choices[""], columns=columns, space=space, shared=True)
    return Chart(caption, choices=choices, columns=columns, space=space, shared=True)


def _table(shown: Shown, groups: Mapping[str, IntArray]) -> TableData:
    measured, corrector = shown.measured, shown.corrector
    parts = [p for p in corrector.parts(measured.raw.shape[1]) if np.isfinite(measured.raw[:, p.columns]).any()]
    methods = corrector.METHODS if len(parts) <= WIDE_TABLE else (corrector.METHODS[0], corrector.METHODS[2])
    head = ["trajectory", "samples", "rejected", "s"]
    head += [f"{part.name} {method_words(method)} [{part.unit}]" for part in parts for method in methods]
    head += ["max", "inside 95 %", "in domain"]
    rows = []
    for key, index in groups.items():
        here = shown.log.trajectory == int(key)
        means = [np.nanmean(part.sizes(measured.of(m)[index])) for part in parts for m in methods]
        inside = np.abs(measured.corrected[index]) <= measured.interval95[index]
        known = np.isfinite(measured.corrected[index])
        rows.append(
            [
                key,
                str(len(index)),
                str(int(np.count_nonzero(here & ~shown.cleaning.keep))),
                f"{np.ptp(shown.log.time[here]):.1f}",
                *(f"{mean:.3f}" for mean in means),
                f"{np.nanmax(parts[0].sizes(measured.corrected[index])):.3f}",
                f"{100 * inside[known].mean():.0f} %" if known.any() else "-",
                f"{100 * measured.in_domain[index].mean():.0f} %",
            ]
        )
    note = (
        f"Mean length of the error of each part; max: of the {parts[0].name}, {corrector.METHODS[2]} [{parts[0].unit}]."
    )
    return TableData(head, rows, note, keys=list(groups))


def _panels(shown: Shown, index: IntArray, key: str) -> tuple[list[Panel], list[Panel], list[Panel]]:
    """Return paths in space, paths over time, and errors over time, of samples `index`; -1 leaves a gap."""
    measured, words, axes = shown.measured, words_of(shown.corrector), shown.axes
    here = np.ones(len(shown.log), dtype=bool) if key == "" else shown.log.trajectory == int(key)
    start = shown.log.time[here][0]
    time, spans = _taken(measured.time - start, index), rejected_spans(shown.log, shown.cleaning, here)
    target = reference(shown.corrector, shown.log, measured)
    axes = [axis for axis in axes if axis.column < target.shape[1]]
    reached = measured.of(shown.corrector.METHODS[words.reached_method])
    paths = [
        (words.reference, Mark.DASH, Role.INK, np.zeros(reached.shape)),
        (words.reached, Mark.LINE, Role.RAW, reached),
        (words.answer, Mark.LINE, Role.CORRECTED, measured.corrected),
    ]
    drawn = [
        (name, mark, role, [_taken(a.scale * (target[:, a.column] - error[:, a.column]), index) for a in axes])
        for name, mark, role, error in paths
    ]
    over_time = [
        Panel("time [s]", axis.label, [Series(n, mark, role, time, c[i]) for n, mark, role, c in drawn], spans=spans)
        for i, axis in enumerate(axes)
    ]
    return _in_space(drawn, axes, time), over_time, _errors(shown, index, time, spans)


Drawn = list[tuple[str, Mark, Role, list[FloatArray]]]


def _in_space(drawn: Drawn, axes: list[Axis], time: FloatArray) -> list[Panel]:
    """Return the paths over the three coordinates, or the first three joints; nothing where there are fewer."""
    if len(axes) < 3:
        return []
    series = [Series(name, mark, role, c[0], c[1], z=c[2], value=time) for name, mark, role, c in drawn]
    return [Panel(axes[0].label, axes[1].label, series, z_label=axes[2].label, equal=axes[0].name == "x")]


def _errors(shown: Shown, index: IntArray, time: FloatArray, spans: list[tuple[float, float, str]]) -> list[Panel]:
    measured, panels = shown.measured, []
    methods = list(zip(shown.corrector.METHODS, METHOD_ROLES, strict=True))[1:]
    for i, name, unit, scale in shown.axes:
        half = _taken(scale * measured.interval95[:, i], index)
        series = [Series("95 % interval", Mark.BAND, Role.CORRECTED, time, -half, y2=half)]
        series += [
            Series(method_words(m), Mark.LINE, role, time, _taken(scale * measured.of(m)[:, i], index))
            for m, role in methods
        ]
        panels.append(Panel("time [s]", f"{name} error [{unit}]", series, spans=spans, height=160))
    return panels


def rejected_spans(log: CalibrationLog, cleaning: CleaningReport, here: np.ndarray) -> list[tuple[float, float, str]]:
    """Return from when to when samples of a trajectory were rejected, s from its start, and why.

    Parameters
    ----------
    log : CalibrationLog
        n samples.
    cleaning : CleaningReport
        Of the log.
    here : (n,) mask
        The trajectory.
    """
    time, reason = log.time[here] - log.time[here][0], np.asarray(cleaning.reason)[here]
    half = float(np.median(np.diff(time))) / 2 if len(time) > 1 else 0.0
    return [
        (float(time[run[0]] - half), float(time[run[-1]] + half), f"rejected: {Reason(str(reason[run[0]])).sentence}")
        for run in _runs(reason)
        if reason[run[0]]
    ]


def _runs(labels: np.ndarray) -> Iterator[IntArray]:
    """Yield the places of each unbroken run of one label."""
    yield from np.split(np.arange(len(labels)), np.flatnonzero(labels[1:] != labels[:-1]) + 1)


def _thinned(rows: IntArray, index: IntArray, step: int) -> IntArray:
    """Return one in `step` of the samples `index`, with -1 where their `rows` of the log do not touch."""
    break_, pieces = np.array([-1]), []
    for run in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
        pieces += [index[run[::step]], index[run[-1:]] if step > 1 else index[:0], break_]
    return np.concatenate(pieces[:-1]).astype(np.int64)


def _taken(values: FloatArray, index: IntArray) -> FloatArray:
    """Return the rows of an array; NaN for -1."""
    taken = np.array(values[index], dtype=np.float64)
    taken[index < 0] = np.nan
    return taken
