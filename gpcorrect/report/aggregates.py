"""All measured samples together: how large errors are, at what speed, where, and inside which intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import norm

from gpcorrect.calibration import Corrector, Measured, PartErrors, part_errors
from gpcorrect.calibration.dataset import evenly_spread
from gpcorrect.report.page import Chart, Mark, Panel, Role, Section, Series, TableData
from gpcorrect.report.paths import LEAVES, METHOD_ROLES, METHOD_WORDS, Shown, leaves
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.types import BoolArray, FloatArray

SPEED_BINS = 8  # that hold equally many samples; chosen by hand
LEVELS = 200  # points of a distribution's line; chosen by hand
CELLS = 24  # of a map, along its wider axis; chosen by hand
MOST_POINTS = 2500  # of a scatter plot; chosen by hand
Z95 = float(norm.ppf(0.975))  # of a normal law
SIX = (Role.CORRECTED, Role.SKY, Role.GOOD, Role.RAW, Role.RIGID, Role.DROPPED, Role.INK)


def errors_section(shown: Shown, dirty: Measured) -> Section:
    """Return tables of errors, of samples that pass cleaning and of all, and charts of the former.

    Parameters
    ----------
    shown : Shown
    dirty : Measured, all samples of the recording
    """
    corrector, measured = shown.corrector, shown.measured
    tables = [
        _table(part_errors(corrector, measured), "Samples that pass cleaning: length of the error."),
        _table(part_errors(corrector, dirty), "All samples, the faults of the outside sensor included."),
        *_by_axis(shown),
    ]
    charts = [distribution_chart(_sizes(corrector, measured), METHOD_ROLES), *_by_speed(corrector, measured)]
    return Section("How large the errors are", (), tables, charts)


def _table(errors: Sequence[PartErrors], note: str) -> TableData:
    parts = list(dict.fromkeys(row.part for row in errors))
    together = sorted(errors, key=lambda row: parts.index(row.part))
    rows = [[f"{row.part}, {METHOD_WORDS[row.method]}", *leaves(row), row.unit] for row in together]
    return TableData(["", *LEAVES, "unit"], rows, note)


def _by_axis(shown: Shown) -> list[TableData]:
    """Return the errors by coordinate; of joints, each is a part already."""
    measured, axes = shown.measured, shown.axes
    if len(shown.corrector.parts(measured.raw.shape[1])) == measured.raw.shape[1]:
        return []
    rows = [
        [METHOD_WORDS[m], *(_mean_sd(axis.scale * measured.of(m)[:, axis.columns]) for axis in axes)]
        for m in shown.corrector.METHODS
    ]
    note = "Mean absolute error and its SD, per axis of the base frame."
    return [TableData(["", *(axis.label for axis in axes)], rows, note)]


def _mean_sd(errors: FloatArray) -> str:
    size = np.abs(errors[np.isfinite(errors)])
    return f"{size.mean():.3f} ± {size.std():.3f}" if size.size else "-"


def _sizes(corrector: Corrector, measured: Measured) -> list[tuple[str, dict[str, FloatArray]]]:
    """Return label of each measured part, and by method the sizes of its errors (n,)."""
    return [
        (f"{part.name} error [{part.unit}]", {METHOD_WORDS[m]: part.sizes(measured.of(m)) for m in corrector.METHODS})
        for part in corrector.measured_parts(measured)
    ]


def distribution_chart(errors: Sequence[tuple[str, Mapping[str, FloatArray]]], roles: Sequence[Role]) -> Chart:
    """Return the fraction of samples below an error, a panel a part.

    Parameters
    ----------
    errors : sequence of (str, mapping), label of a part, and the sizes (n,) of its errors by the name of a line
    roles : sequence of Role
    """
    panels = []
    for label, sizes in errors:
        series = []
        for (name, size), role in zip(sizes.items(), roles, strict=True):
            known = np.sort(size[np.isfinite(size)])
            place = evenly_spread(len(known), LEVELS)
            series.append(Series(name, Mark.LINE, role, known[place], 100 * (place + 1) / len(known)))
        panels.append(Panel(label, "samples below [%]", series, log_x=True, y_range=(0, 100), height=220))
    return Chart("Fraction of samples with an error below the value on the axis.", panels, columns=2)


def _by_speed(corrector: Corrector, measured: Measured) -> list[Chart]:
    speed = 100 * measured.speed
    if not np.isfinite(speed).any() or np.ptp(speed) == 0:
        return []
    edges = np.unique(np.quantile(speed, np.linspace(0, 1, SPEED_BINS + 1)))
    index = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, max(len(edges) - 2, 0))
    bins = [index == i for i in np.unique(index)]
    middle = np.array([np.median(speed[rows]) for rows in bins])
    panels = []
    for label, sizes in _sizes(corrector, measured):
        series = []
        for (name, size), role in zip(sizes.items(), METHOD_ROLES, strict=True):
            half, most = np.array([np.nanpercentile(size[rows], (50, 90)) for rows in bins]).T
            series.append(Series(name, Mark.BAND, role, middle, half, y2=most))
            series.append(Series(name, Mark.LINE, role, middle, half))
        panels.append(Panel("speed [cm/s]", label, series, height=220))
    return [Chart("By the speed of the tool: median, and the band up to the 90th percentile.", panels, columns=2)]


def map_chart(shown: Shown, position: FloatArray) -> Chart:
    """Return the mean position error over the workspace, after the simplest remedy and corrected, on one scale.

    Parameters
    ----------
    shown : Shown
    position : (n, 3) array, where they are, m
    """
    part, (_, before, after) = shown.corrector.parts(3)[0], shown.corrector.METHODS
    sizes = [(m, part.sizes(shown.measured.of(m))) for m in (before, after)]
    largest = float(np.nanpercentile(sizes[0][1], 98)) or 1.0
    panels = [
        _cells(100 * position[:, [i, j]], size, ("xyz"[i], "xyz"[j]), METHOD_WORDS[method], largest)
        for i, j in _views(position)
        for method, size in sizes
    ]
    caption = f"Mean length of the position error where the tool was; full colour from {largest:.2g} mm."
    return Chart(caption, panels, columns=2)


def _cells(place: FloatArray, size: FloatArray, names: tuple[str, str], title: str, largest: float) -> Panel:
    low, side = place.min(axis=0), float(np.ptp(place, axis=0).max()) / CELLS or 1.0
    cells, inverse = np.unique(((place - low) / side).astype(int), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    mean = np.bincount(inverse, np.nan_to_num(size)) / np.bincount(inverse)
    x, y = (low + side * cells).T
    series = Series("mm", Mark.CELLS, Role.RAW, x, y, x2=x + side, y2=y + side, value=mean)
    return Panel(f"{names[0]} [cm]", f"{names[1]} [cm]", [series], title=title, equal=True, largest=largest, height=300)


def coverage_chart(train: FloatArray, test: FloatArray, in_domain: BoolArray) -> Chart:
    """Return where the training was, and which measured samples lie near it.

    Parameters
    ----------
    train, test : (n, 3) and (m, 3) arrays, observed positions, m
    in_domain : (m,) mask, of the measured ones
    """
    groups = (
        ("training", Mark.DOTS, Role.QUIET, 2.0, train),
        ("measured, in domain", Mark.DOTS, Role.CORRECTED, 3.0, test[in_domain]),
        ("measured, outside", Mark.CROSSES, Role.RAW, 0.0, test[~in_domain]),
    )
    panels = []
    for i, j in _views(train):
        series = []
        for name, mark, role, size, place in groups:
            x, y = 100 * place[evenly_spaced(len(place), MOST_POINTS)][:, [i, j]].T
            series.append(Series(name, mark, role, x, y, size=size))
        panels.append(Panel(f"{'xyz'[i]} [cm]", f"{'xyz'[j]} [cm]", series, equal=True, height=300))
    return Chart("Where the training was, and the measured samples near it and outside.", panels, columns=2)


def _views(position: FloatArray) -> list[tuple[int, int]]:
    """Planes to draw: the widest axis against each of the others, the wider one first."""
    widest, second, third = (int(i) for i in np.argsort(-np.ptp(position, axis=0)))
    return [(widest, second), (widest, third)]


def intervals_section(shown: Shown) -> Section:
    """Return the observed coverage of central intervals of every level: on the diagonal they are honest.

    The calibrated 95 % half width fixes the scale; other levels follow the normal shape.

    Parameters
    ----------
    shown : Shown
    """
    measured, axes = shown.measured, shown.axes
    covered = [f"{100 * measured.coverage95[axis.columns[0]]:.1f} %" for axis in axes]
    table = TableData(["95 % interval", *(axis.name for axis in axes)], [["observed", *covered]])
    levels = np.linspace(0.05, 0.99, 40)
    percent, ends = 100 * levels, np.array([0.0, 100.0])
    series = [Series("honest", Mark.DASH, Role.QUIET, ends, ends)]
    for n, axis in enumerate(axes):
        error, half = np.abs(measured.corrected[:, axis.columns]), measured.interval95[:, axis.columns]
        known = np.isfinite(error) & np.isfinite(half)
        observed = [100 * np.mean(error[known] <= half[known] * norm.ppf(0.5 + v / 2) / Z95) for v in levels]
        series.append(Series(axis.name, Mark.LINE, SIX[n % len(SIX)], percent, np.array(observed)))
    panel = Panel("nominal coverage [%]", "observed coverage [%]", series, y_range=(0, 100), height=300)
    caption = "Observed against nominal coverage; on the diagonal the intervals are honest."
    near = f"{100 * float(measured.in_domain.mean()):.1f} % of the samples lie near training data."
    return Section("Are the intervals honest?", (near,), (table,), (Chart(caption, [panel]),))
