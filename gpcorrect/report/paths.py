"""Measured trajectories of each task: a table that chooses, paths in space and over time, and errors, with gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect.calibration import COMPONENTS, CommandCorrector, Corrector, JointCorrector, Measured, PartErrors
from gpcorrect.calibration.joint_view import directed
from gpcorrect.calibration.task import Part
from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.report.page import Chart, Mark, Panel, Role, Section, Series, TableData, runs, stretches
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

METHOD_ROLES = (Role.RAW, Role.RIGID, Role.CORRECTED)  # of the methods: before, after the simplest remedy, corrected
METHOD_WORDS = {
    "raw": "before",
    "rigid": "registered",
    "fixed_offset": "fixed offset",
    "corrected": "corrected",
    "estimated": "estimated",
}
MOST_SAMPLES = 6000  # drawn on a page: of seven joints and two models they take three megabytes; chosen by hand
MOST_TRAJECTORIES = 300  # in the table and the charts; the page names how many there are; chosen by hand

WIDE_TABLE = 2  # parts up to which the table shows all three methods; chosen by hand
LEAVES = ("mean", "SD", "rmse", "p95", "max")  # columns of tables of errors


@dataclass(frozen=True)
class Words:
    """Names of paths."""

    reference: str  # the path that is to be hit
    reached: str  # where the arm, or its report, was instead
    reached_method: int  # which of the three methods' errors leads there
    answer: str  # what the model gives
    errors: str  # what an error is, in a sentence


WORDS: Mapping[str, Words] = {
    "pose": Words(
        "commanded",
        "reached, registered",
        1,
        "corrected",
        "Errors are commands that were given, minus the commands that would have been given for the observed poses.",
    ),
    "estimate": Words(
        "true", "reported", 0, "corrected", "Errors are true joints minus reported, and minus corrected ones."
    ),
    "command": Words(
        "commanded", "desired", 0, "corrected", "Errors are joints that were commanded, minus those the model commands."
    ),
    "tool_position": Words(
        "true", "reported", 0, "estimated", "Errors are the tracker's positions minus reported, and estimated ones."
    ),
}


def words_of(corrector: Corrector) -> Words:
    """Return the names for a model's task."""
    return WORDS[corrector.view.direction if isinstance(corrector, JointCorrector) else corrector.TASK]


def _reference(corrector: Corrector, log: CalibrationLog, measured: Measured) -> FloatArray:
    """Return what was to be hit at the measured samples `(n, d)`: positions or joints; less an error, it is a path."""
    if isinstance(corrector, JointCorrector):
        truth = directed(log, corrector.view.input_signal, corrector.view.direction)[1]
        assert truth is not None
        return truth[measured.rows]
    if isinstance(corrector, CommandCorrector):
        assert log.setpoint_cp is not None
        return log.setpoint_cp.position[measured.rows]
    assert log.measured_cp is not None
    return np.asarray(log.measured_cp.position[measured.rows] + measured.raw)


class Line(NamedTuple):
    """Errors `(n, m)` of one method, m or rad, how they are drawn, and the half widths of their 95 % intervals.

    The intervals are `folded` where they are shown on a click only.
    """

    name: str
    mark: Mark
    role: Role
    errors: FloatArray
    interval95: FloatArray | None = None
    folded: bool = False


@dataclass(frozen=True, eq=False)
class Shown:
    """A measured recording as its page shows it."""

    corrector: Corrector
    measured: Measured  # samples that pass cleaning
    cleaning: CleaningReport  # why the others do not
    log: CalibrationLog  # all of them

    @property
    def axes(self) -> list[Part]:
        """Components of errors that were measured, each as a part of one column."""
        corrected = self.measured.corrected
        axes = [
            Part(part.name if len(part.columns) == 1 else COMPONENTS[i], part.unit, (i,), part.scale)
            for part in self.corrector.parts(corrected.shape[1])
            for i in part.columns
        ]
        return [axis for axis in axes if np.isfinite(corrected[:, axis.columns]).any()]

    def groups(self) -> dict[str, IntArray]:
        """Return the measured samples of each trajectory, by its number; of static poses all together."""
        if self.log.static:
            return {"": np.arange(len(self.measured.rows))}
        numbers = self.measured.trajectory
        measured = set(numbers.tolist())
        ids = [number for number in self.log.trajectory_ids.tolist() if number in measured]
        return {str(number): np.flatnonzero(numbers == number) for number in ids[:MOST_TRAJECTORIES]}


def path_charts(shown: Shown, paths: Sequence[Line], errors: Sequence[Line]) -> list[Chart]:
    """Return paths in space, paths over time, and errors over time, of the trajectory that is chosen.

    Parameters
    ----------
    shown : Shown
    paths : sequence of Line, whose errors, taken off the reference, are drawn as paths beside it
    errors : sequence of Line, that are drawn as errors
    """
    groups, target = shown.groups(), _reference(shown.corrector, shown.log, shown.measured)
    if shown.log.static:  # nothing joins one pose to the next
        paths, errors = ([line._replace(mark=Mark.DOTS) for line in lines] for lines in (paths, errors))
    step = -(-sum(map(len, groups.values())) // MOST_SAMPLES)
    drawn = {}
    for key, rows in groups.items():
        index = _thinned(shown.measured.rows[rows], rows, step)
        drawn[key] = _panels(shown, key, index, target, paths, errors)
    thin = f" Every {step}th sample is drawn." if step > 1 else ""
    gaps = " Shaded: samples that cleaning rejected; lines have gaps there." if not shown.cleaning.keep.all() else ""
    names = [words_of(shown.corrector).reference, *(path.name for path in paths)]
    band = " and the 95 % interval around no error" if any(line.interval95 is not None for line in errors) else ""
    start, along = ("", "in order") if shown.log.static else ("; dots mark the start", "over time")
    captions = (
        f"In space: {', '.join(names)}. Drag to turn{start}.",
        f"The same {along}.{gaps}{thin} Drag to zoom, double-click to go back.",
        f"Errors{band}.{gaps}",
    )
    charts = []
    for i, caption in enumerate(captions):
        if all(found[i] for found in drawn.values()):
            choices = {key: found[i] for key, found in drawn.items()}
            columns = 2 if len(next(iter(choices.values()))) > 3 else 1  # of more panels than fit above each other
            static = choices.pop("", [])
            charts.append(Chart(caption, static, choices, columns=columns, space=i == 0, shared=True))
    return charts


def _panels(
    shown: Shown, key: str, index: IntArray, target: FloatArray, paths: Sequence[Line], errors: Sequence[Line]
) -> tuple[list[Panel], list[Panel], list[Panel]]:
    """Return panels in space, over time and of errors of one trajectory; -1 in `index` of its samples leaves a gap."""
    log = shown.log
    here = np.arange(len(log)) if key == "" else np.flatnonzero(log.trajectory == int(key))
    begin, reason = log.time[here[0]], np.asarray(shown.cleaning.reason)[here]
    time = _taken(shown.measured.time - begin, index)
    spans = [(a, b, f"rejected: {Reason(why).sentence}") for a, b, why in stretches(log.time[here] - begin, reason)]
    axes = [axis for axis in shown.axes if axis.columns[0] < target.shape[1]]
    mark, along = (Mark.DOTS, "pose") if shown.log.static else (Mark.DASH, "time [s]")
    zero = Line(words_of(shown.corrector).reference, mark, Role.INK, np.zeros(shown.measured.raw.shape))
    drawn = []
    for line in (zero, *paths):
        path = target - line.errors[:, : target.shape[1]]
        drawn.append((line, [_taken(a.scale * path[:, a.columns[0]], index) for a in axes]))
    over_time = []
    for i, axis in enumerate(axes):
        series = [Series(line.name, line.mark, line.role, time, columns[i]) for line, columns in drawn]
        over_time.append(Panel(along, axis.label, series, spans=spans))
    space = []
    if len(axes) >= 3:  # the coordinates, or the first three joints
        x, y, z = axes[:3]
        series = [Series(n.name, n.mark, n.role, c[0], c[1], z=c[2], value=time) for n, c in drawn]
        space = [Panel(x.label, y.label, series, z_label=z.label, equal=x.name == "x")]
    in_time = [
        Panel(along, f"{axis.name} error [{axis.unit}]", _errors(axis, time, index, errors), spans=spans, height=160)
        for axis in shown.axes
    ]
    return space, over_time, in_time


def _errors(axis: Part, time: FloatArray, index: IntArray, lines: Sequence[Line]) -> list[Series]:
    """Return errors along one axis, and below all of them their intervals."""
    (i,), series = axis.columns, []
    for line in lines:
        if line.interval95 is not None:
            half, called = _taken(axis.scale * line.interval95[:, i], index), f"95 % interval, {line.name}"
            series.append(Series(called, Mark.BAND, line.role, time, -half, y2=half, hidden=line.folded))
    for line in lines:
        error = _taken(axis.scale * line.errors[:, i], index)
        series.append(Series(line.name, line.mark, line.role, time, error))
    return series


def _thinned(rows: IntArray, index: IntArray, step: int) -> IntArray:
    """Return one in `step` of the samples `index`, with -1 where their `rows` of the log do not touch."""
    gap, pieces = np.array([-1]), []
    for run in runs(rows - np.arange(len(rows))):
        pieces += [index[run[::step]], index[run[-1:]] if step > 1 else index[:0], gap]
    return np.concatenate(pieces[:-1]).astype(np.int64)


def _taken(values: FloatArray, index: IntArray) -> FloatArray:
    """Return the rows of an array; NaN for -1."""
    taken = np.array(values[index], dtype=np.float64)
    taken[index < 0] = np.nan
    return taken


def trajectories_section(shown: Shown) -> Section:
    """Return the table of trajectories, and the charts of the one that is chosen in it.

    Parameters
    ----------
    shown : Shown
    """
    corrector, measured, words = shown.corrector, shown.measured, words_of(shown.corrector)
    reached = measured.of(corrector.METHODS[words.reached_method])
    paths = [
        Line(words.reached, Mark.LINE, Role.RAW, reached),
        Line(words.answer, Mark.LINE, Role.CORRECTED, measured.corrected),
    ]
    middle, last = corrector.METHODS[1:]
    errors = [
        Line(METHOD_WORDS[middle], Mark.LINE, METHOD_ROLES[1], measured.registered),
        Line(METHOD_WORDS[last], Mark.LINE, METHOD_ROLES[2], measured.corrected, measured.interval95),
    ]
    charts = path_charts(shown, paths, errors)
    if shown.log.static:
        return Section("Static poses, in the order of the recording", (words.errors,), (), charts)
    groups = shown.groups()
    return Section("Trajectory by trajectory", (words.errors, listed(shown)), (_table(shown, groups),), charts)


def typical_trajectory(groups: Mapping[str, IntArray], measured: Measured) -> str:
    """Return which of the trajectories that a page lists has the median mean corrected error.

    Parameters
    ----------
    groups : mapping, as `Shown.groups` returns
    measured : Measured, the same samples; joints that were not measured count nothing
    """
    size = np.linalg.norm(np.nan_to_num(measured.corrected[:, :3]), axis=1)
    means = [size[index].mean() for index in groups.values()]
    return list(groups)[int(np.argsort(means)[len(means) // 2])]


def listed(shown: Shown) -> str:
    """Return what the table of trajectories does, and whether it shows all of them.

    Parameters
    ----------
    shown : Shown
    """
    total, count = len(np.unique(shown.measured.trajectory)), len(shown.groups())
    more = f" The first {count} of {total} are listed." if total > count else ""
    return f"Choose a row to see that trajectory below; column names sort.{more}"


def leaves(row: PartErrors) -> list[str]:
    """Return what tables show of the errors of a part, in the order of `LEAVES`.

    Parameters
    ----------
    row : PartErrors
    """
    return [f"{value:.3f}" for value in (row.mean, row.sd, row.rmse, row.p95, row.max)]


def inside95(measured: Measured, index: IntArray) -> str:
    """Return the fraction of errors inside their 95 % intervals, in words.

    Parameters
    ----------
    measured : Measured
    index : (k,) int array, of its samples
    """
    known = np.isfinite(measured.corrected[index])
    inside = np.abs(measured.corrected[index]) <= measured.interval95[index]
    return f"{100 * inside[known].mean():.0f} %" if known.any() else "-"


def _table(shown: Shown, groups: Mapping[str, IntArray]) -> TableData:
    measured, corrector = shown.measured, shown.corrector
    parts = corrector.measured_parts(measured)
    methods = corrector.METHODS if len(parts) <= WIDE_TABLE else (corrector.METHODS[0], corrector.METHODS[2])
    head = ["trajectory", "samples", "rejected", "s"]
    head += [f"{part.name} {METHOD_WORDS[method]} [{part.unit}]" for part in parts for method in methods]
    head += ["max", "inside 95 %", "in domain"]
    rows = []
    for key, index in groups.items():
        here = shown.log.trajectory == int(key)
        means = [np.nanmean(part.sizes(measured.of(m)[index])) for part in parts for m in methods]
        rows.append(
            [
                key,
                str(len(index)),
                str(int(np.count_nonzero(here & ~shown.cleaning.keep))),
                f"{np.ptp(shown.log.time[here]):.1f}",
                *(f"{mean:.3f}" for mean in means),
                f"{np.nanmax(parts[0].sizes(measured.corrected[index])):.3f}",
                inside95(measured, index),
                f"{100 * measured.in_domain[index].mean():.0f} %",
            ]
        )
    first, last = parts[0], METHOD_WORDS[corrector.METHODS[2]]
    note = f"Mean length of the error of each part; max: of the {first.name}, {last} [{first.unit}]."
    return TableData(head, rows, note, keys=list(groups))
