"""The page of `gpcorrect reproduce peng2024`: the study's tables and figures made again, beside its own numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.report.page import Chart, Mark, Panel, Role, Section, Series, TableData
from gpcorrect_studies.claims_page import paired, setup_section, write_study_page
from gpcorrect_studies.peng2024.study import CLAIMS, PENG_COMPARABLE, PENG_NOT_COMPARABLE, Peng2024

NAMES = {
    "raw": "as reported",
    "fixed_offset": "fixed offset",
    "linear": "linear",
    "quadratic": "2nd order",
    "network": "network",
    "ukf": "UKF",
    "gp": "ours (gp)",
}
DRAWN = {"network": Role.RAW, "gp": Role.CORRECTED}
ALL_DRAWN = {"linear": Role.RIGID, "quadratic": Role.DROPPED, **DRAWN, "ukf": Role.QUIET}
JOINTS = ("J1 [deg]", "J2 [deg]", "J3 [mm]")
PAPERS = tuple(NAMES)[:5]  # methods of the paper's tables, in our order of columns
HEADLINE = CLAIMS.printed["table1"]["J2-J3"]["network"]["mean"]  # the dotted lines of the figures
# What the cells of most tables are.
RMSE = "RMSE on the test run, mean ± SD over repeats (training recordings with other noise, and other seeds)."


def write_peng_report(result: Peng2024, path: Path) -> None:
    """Write the self-contained page; raises as :func:`write_study_page`.

    Parameters
    ----------
    result : Peng2024
    path : Path
    """
    ours, network = result.percent_of_offset("gp"), result.percent_of_offset("network")
    verdict = (
        f"After the longest zig-zag the study's network leaves {_list(network, '.1f')} % of the fixed offset's error "
        f"of joints 1, 2 and 3 (the paper's {_list(result.percent_printed(), '.1f')} %, on a real robot), ours "
        f"{_list(ours, '.1f')} %."
    )
    scope = result.scope
    facts = [
        ("robot", f"simulated RAVEN-II, joints 1 to 3, seed {result.seed}"),
        ("test", f"{scope.minutes:g} min of random sweeps, each joint for itself"),
        ("repeats", f"{scope.repeats}, of the network {scope.network_repeats}"),
        ("zig-zag J1-J2-J3", "as the study's published files" if result.as_published else "as its Eq. (3) says"),
    ]
    sections = [
        _table1(result),
        _fig5(result),
        _fig6(result),
        _fig8(result),
        _fig9(result),
        _table2(result),
        _table3(result),
        _table4(result),
        _table5(result),
        _targets(result),
        setup_section(CLAIMS.setup, {"features_few": result.fig8["few"], "features_whole": result.fig8["whole"]}),
        Section("What is comparable", PENG_COMPARABLE),
        Section("What is not", PENG_NOT_COMPARABLE),
    ]
    write_study_page(result, verdict, facts, sections, path)


def _targets(result: Peng2024) -> Section:
    titles = {
        "share_longest": ("ours after the longest zig-zag, % of the fixed offset's error", ".1f"),
        "shortest_against_network": ("ours after the shortest zig-zag, against the network's (deg, deg, mm)", ".3f"),
        "stream_ms": ("one estimate of ours in process, ms", ".3f"),
    }
    rows = []
    for name, target in result.targets().items():
        title, form = titles[name]
        met = ", ".join("yes" if one else "no" for one in target["met"])
        rows.append([title, f"below {_list(target['target'], form)}", _list(target["measured"], form), met])
    return Section("Targets", (), (TableData(["", "target", "here", "met"], rows, text=(1, 2, 3)),))


def _table1(result: Peng2024) -> Section:
    printed, methods = CLAIMS.printed["table1"], tuple(next(iter(result.table1.values())))
    tables = []
    for joint, head in enumerate(JOINTS):
        ours = {d: [_cell(row[m], joint) for m in methods] for d, row in result.table1.items()}
        papers = {d: [_printed(row, m, joint) for m in PAPERS] for d, row in printed.items()}
        tables.append(TableData([f"{head}, trained along", *(NAMES[m] for m in methods)], paired(ours, papers)))
    words = [
        f"Zig-zags of sparsity 1/{result.scope.middle.sparsity}. {RMSE} The first {len(PAPERS)} columns are "
        "the paper's.",
        "A joint that hardly turns back in training (joints 2 and 3 along J1) shows too little of its friction and "
        "slack to any method; ours leaves out what the motion does not show, and says so.",
    ]
    return Section("Table I: training directions", words, tables)


def _fig5(result: Peng2024) -> Section:
    rows = []
    for point in result.fig5:
        cells = (point["rmse"][method] for method in ("linear", "network", "gp"))
        rows.append([f"1/{point['sparsity']}", f"{point['minutes']:.1f}", *(_list(cell["mean"]) for cell in cells)])
    table = TableData(["sparsity", "minutes", "linear", "network", "ours (gp)"], rows, "Deg, deg, mm.")
    minutes = [point["minutes"] for point in result.fig5]
    curves = [
        (NAMES[method], Mark.LINE, role, minutes, [point["rmse"][method] for point in result.fig5])
        for method, role in ALL_DRAWN.items()
    ]
    caption = f"RMSE by minutes of the zig-zag along {result.scope.later}; bands are one SD of the repeats."
    chart = _by_joint(caption, curves, "zig-zag [min]", HEADLINE)
    return Section("Fig. 5: sparsity and time", (), (table,), (chart,))


def _fig6(result: Peng2024) -> Section:
    rows = []
    for use, part in result.fig6.items():
        for method, cells in part["rmse"].items():
            rows.append([f"{use}, {NAMES[method]}", _list(cells[0]["mean"]), _list(cells[-1]["mean"])])
    hours = result.scope.hours
    table = TableData(["", f"after {hours[0]:g} h", f"after {hours[-1]:g} h"], rows, "RMSE, deg, deg, mm.")
    curves = [
        (f"{NAMES[method]}, {use}", mark, role, hours, result.fig6[use]["rmse"][method])
        for use, mark in {"idle": Mark.CROSSES, "unloaded": Mark.DASH, "loaded 500 g": Mark.LINE}.items()
        for method, role in DRAWN.items()
    ]
    chart = _by_joint(
        "Errors of models of the fresh robot, hours later. Solid: loaded; dashed: unloaded; crosses: idle.",
        curves,
        "hours of use",
    )
    words = [
        "How fast joint 1 drifts was chosen, with and without the load. No model was trained under load: what it does "
        "at once is seen at 0 h."
    ]
    return Section("Fig. 6: six hours idle, unloaded and loaded", words, (table,), (chart,))


def _fig8(result: Peng2024) -> Section:
    part = result.fig8
    rows = [
        [f"{NAMES[method]}, {part[which]} features", *(_cell(pair[which], joint) for joint in range(3))]
        for method, pair in part["rmse"].items()
        for which in ("few", "whole")
    ]
    words = [
        f"The paper had 16 and 138; here {part['few']} (positions and efforts of the three moving joints) and "
        f"{part['whole']} (all that the simulation fills of the state message)."
    ]
    return Section("Fig. 8: few features against the whole state", words, (TableData(["", *JOINTS], rows, RMSE),))


def _fig9(result: Peng2024) -> Section:
    homings, rows = [point["homings"] for point in result.fig9], []
    curves = [
        (f"{NAMES[method]}, {seen}", mark, role, homings, [point["rmse"][method][seen] for point in result.fig9])
        for seen, mark in {"none seen": Mark.LINE, "one seen": Mark.DASH, "new zero": Mark.CROSSES}.items()
        for method, role in DRAWN.items()
    ]
    for point in result.fig9:
        for method in DRAWN:
            cells = point["rmse"][method]
            rows.append([f"{point['homings']}, {NAMES[method]}", *(_list(cell["mean"]) for cell in cells.values())])
    heads = list(next(iter(result.fig9[0]["rmse"].values())))
    table = TableData(["homings", *(f"{head} (deg, deg, mm)" for head in heads)], rows)
    caption = "Errors after homings. Solid: none seen in training; dashed: one seen; crosses: new zero."
    chart = _by_joint(caption, curves, "homings after the training")
    words = ["How far a homing shifts the joints was chosen. The new zero, from a minute of the session, is ours."]
    return Section("Fig. 9: homings", words, (table,), (chart,))


def _table2(result: Peng2024) -> Section:
    printed = CLAIMS.printed["table2"]
    ours, papers = (
        {
            f"{NAMES[method]}, {target}": [show(pair, target, joint) for joint in range(3)]
            for method, pair in table.items()
            for target in pair
        }
        for table, show in ((result.table2, _measured), (printed, _printed))
    )
    words = ["What is learned: the error, or the position itself."]
    return Section("Table II: error against end to end", words, (TableData(["", *JOINTS], paired(ours, papers), RMSE),))


def _table3(result: Peng2024) -> Section:
    """Return the hours that the paper prints, and the last one; Fig. 6 draws all."""
    shown = {hour for hours in CLAIMS.printed["table3"].values() for hour in hours} | {f"{result.scope.hours[-1]:g} h"}
    rows = {
        f"{NAMES[method]}, {use}, {hour}": [_cell(cell, joint) for joint in range(3)]
        for use, hours in result.table3.items()
        for hour, methods in hours.items()
        if hour in shown
        for method, cell in methods.items()
    }
    printed = {
        f"{NAMES[method]}, {use}, {hour}": [_printed(row, method, joint) for joint in range(3)]
        for use, hours in CLAIMS.printed["table3"].items()
        for hour, row in hours.items()
        for method in row
    }
    return Section("Table III: joints after hours", (), (TableData(["", *JOINTS], paired(rows, printed), RMSE),))


def _table4(result: Peng2024) -> Section:
    heads = ("x [mm]", "y [mm]", "z [mm]", "distance [mm]")
    rows, printed = (
        {
            f"{NAMES[method]}, {name}": [show(row, method, part) for part in range(len(heads))]
            for name, row in table.items()
            for method in row
        }
        for table, show in ((result.table4, _measured), (CLAIMS.printed["table4"], _printed))
    )
    words = [
        "Estimated joints through the kinematics to the tip, the tool's own joints at rest, RMSE; the UKF, which needs "
        "no training but its noises and gaps, beside the others."
    ]
    table = TableData(["", *heads], paired(rows, printed), "Trained on the longest zig-zag, unloaded.")
    return Section("Table IV: from joints to the tip", words, (table,))


def _table5(result: Peng2024) -> Section:
    ours = {
        NAMES[method]: [
            f"{part['fit_s']['mean']:.2f} ± {part['fit_s']['sd']:.2f}",
            f"{part['stream_ms']:.4f}",
            f"{part['path_ms']:.5f}",
        ]
        for method, part in result.table5.items()
    }
    bounds = {claim.of: f"below {CLAIMS.printed_number(claim):g}" for claim in CLAIMS.claims}
    printed = {
        NAMES[method]: [bounds[f"table5/{method}/fit_s/mean"], f"{row['stream_ms']:g}"]
        for method, row in CLAIMS.printed["table5"].items()
    }
    table = TableData(
        ["", "fit [s]", "one estimate, live [ms]", "of a whole path [ms a sample]"],
        paired(ours, printed),
        "Live: median of single estimates in one process, features, memory and checks included; nothing is sent.",
    )
    return Section("Table V: time", (), (table,))


def _measured(row: Mapping[str, Any], name: str, place: int) -> str:
    return _cell(row[name], place)


def _printed(row: Mapping[str, Any], name: str, place: int) -> str:
    return f"{row[name]['mean'][place]:g}"


def _cell(cell: Mapping[str, Any], joint: int) -> str:
    mean, spread = cell["mean"][joint], cell["sd"][joint]
    return f"{mean:.3f}" if spread < 5e-4 else f"{mean:.3f} ± {spread:.3f}"


def _list(values: Sequence[float], form: str = ".3f") -> str:
    return ", ".join(format(value, form) for value in values)


def _by_joint(
    caption: str,
    curves: Sequence[tuple[str, Mark, Role, Sequence[float], Sequence[Mapping[str, Any]]]],
    label: str,
    published: Sequence[float] = (),
) -> Chart:
    """Return the RMSE of each of the three joints, mean and SD of the repeats.

    A curve is its name, mark and role, its x, and a cell for each; published errors are dashed lines.
    """
    panels = []
    for joint, unit in enumerate(("deg", "deg", "mm")):
        series = []
        for name, mark, role, x, cells in curves:
            mean, sd = (np.array([cell[leaf][joint] for cell in cells]) for leaf in ("mean", "sd"))
            series.append(Series(name, Mark.BAND, role, x, mean - sd, y2=mean + sd))
            series.append(Series(name, mark, role, x, mean, size=8.0))
        for error in published[joint : joint + 1]:
            ends = np.array([min(curves[0][3]), max(curves[0][3])])
            series.append(Series("the paper's network", Mark.DASH, Role.INK, ends, np.full(2, error)))
        panels.append(Panel(label, f"joint {joint + 1}: RMSE [{unit}]", series, height=240))
    return Chart(caption, panels, columns=2)
