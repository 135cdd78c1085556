"""Measured trajectories one by one: a table that chooses, and the charts of the chosen one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gpcorrect.calibration import Measured, PartErrors
from gpcorrect.report.charts import Mark, Role
from gpcorrect.report.page import Section, TableData
from gpcorrect.report.paths import METHOD_ROLES, METHOD_WORDS, Line, Shown, path_charts, words_of
from gpcorrect.types import IntArray

WIDE_TABLE = 2  # parts up to which the table shows all three methods; chosen by hand
LEAVES = ("mean", "SD", "rmse", "p95", "max")  # columns of tables of errors


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


def typical_trajectory(measured: Measured) -> int:
    """Return the number of the trajectory whose mean corrected error is the median one.

    Parameters
    ----------
    measured : Measured, of a whole recording; joints that were not measured count nothing
    """
    ids = np.unique(measured.trajectory)
    size = np.linalg.norm(np.nan_to_num(measured.corrected[:, :3]), axis=1)
    means = np.array([size[measured.trajectory == i].mean() for i in ids])
    return int(ids[np.argsort(means)[len(ids) // 2]])


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
