"""The page of `gpcorrect reproduce mahler2014`: the paper's tables and figures made again, beside its own numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.report.page import Chart, Mark, Panel, Role, Section, Series, TableData
from gpcorrect.report.paths import Shown, trajectories_section
from gpcorrect.types import FloatArray
from gpcorrect_studies.claims_page import paired, write_study_page
from gpcorrect_studies.mahler2014.closed_loop import summary_of
from gpcorrect_studies.mahler2014.study import CLAIMS, COMPARABLE, NOT_COMPARABLE, Mahler2014
from gpcorrect_studies.mahler2014.table1 import COMPONENTS, METHODS, NORMS, PRINTED, held_out_of

TITLES = {
    "position_percent_of_raw_dirty": "position error after full correction, of the uncorrected one",
    "rotation_percent_of_raw_dirty": "rotation error after full correction, of the uncorrected one",
    "position_percent_of_raw_dirty_memory": "the same with memory of the commands: position",
    "rotation_percent_of_raw_dirty_memory": "the same with memory of the commands: rotation",
    "position_gain_of_velocity": "position error that velocity features take away",
    "position_gain_of_cleaning_on_sd": "spread of the position error that cleaning takes away",
    "rotation_gain_of_cleaning_on_sd": "spread of the rotation error that cleaning takes away",
}
POSITION, ANGLES = COMPONENTS[:3], COMPONENTS[3:]


def write_mahler_report(result: Mahler2014, path: Path) -> None:
    """Write the self-contained page; raises as :func:`write_study_page`.

    Parameters
    ----------
    result : Mahler2014
    path : Path
    """
    percent = result.table1.percent_of_raw("dirty")
    verdict = (
        f"Full correction leaves {percent['position_mm']:.1f} % of the position error and "
        f"{percent['rotation_deg']:.1f} % of the rotation error of the dirty set."
    )
    facts = [
        ("recording", f"simulated: {result.scope.reaches} reaches, {result.samples} samples, seed {result.seed}"),
        ("held out", "the last fifth of the reaches, whole"),
    ]
    sections = [
        _table1(result),
        _fig4(result),
        _fig5(result),
        _table2(result),
        _limits(result),
        _targets(result),
        Section("What is comparable", COMPARABLE),
        Section("What is not", NOT_COMPARABLE),
    ]
    write_study_page(result, verdict, facts, sections, path)


def _targets(result: Mahler2014) -> Section:
    rows = []
    for name, t in result.targets().items():
        least = f"at least {t['target']:g} %" if t["target"] else "less spread"
        bound = f"at most {t['target']:g} %" if "percent_of_raw" in name else least
        rows.append([TITLES[name], f"{t['measured']:.1f} %", bound, "yes" if t["met"] else "no"])
    note = "Means of the error's length. The targets were ours, set before the first full run."
    return Section("Targets", (), (TableData(["dirty set", "here", "target", "met"], rows, note),))


def _table1(result: Mahler2014) -> Section:
    sets = {"dirty": "all samples as they came", "clean": "samples that pass cleaning"}
    words = [
        "Absolute errors of the command that each method would have given for the observed pose, mean (SD). Yaw, pitch "
        "and roll are differences of angles about fixed axes. The columns are the paper's; the last "
        f"{len(METHODS) - len(PRINTED)} are ours.",
        "Methods without cleaning learn from the recording as it came, faults included. The norms are those of the "
        "vector of three means, as the paper's text takes them; the mean lengths are ours.",
    ]
    return Section("Table I", words, [_errors_table(result, which, whole) for which, whole in sets.items()])


def _errors_table(result: Mahler2014, which: str, whole: str) -> TableData:
    """One set of Table I: a row a component as printed, ours under it; columns are methods."""
    measured, printed = result.table1.errors[which], CLAIMS.printed["table1"][which]

    def _norms(errors: Mapping[str, Any], methods: Sequence[str]) -> dict[str, list[str]]:
        parts = {"norm of x, y, z [mm]": POSITION, "norm of yaw, pitch, roll [deg]": ANGLES}
        return {name: [f"{_norm(errors[method], keys):.2f}" for method in methods] for name, keys in parts.items()}

    def _cells(
        errors: Mapping[str, Any], methods: Sequence[str], names: Sequence[str], digits: int
    ) -> dict[str, list[str]]:
        return {_with_unit(name): [_mean_sd(errors[m][name], digits) for m in methods] for name in names}

    ours = _cells(measured, METHODS, COMPONENTS, 2) | _norms(measured, METHODS)
    papers = _cells(printed, PRINTED, COMPONENTS, 1) | _norms(printed, PRINTED)
    lengths = {f"mean length of {name}": cells for name, cells in _cells(measured, METHODS, NORMS, 2).items()}
    return TableData([f"{which} set", *METHODS], paired({**ours, **lengths}, papers), f"Over {whole}.")


def _norm(errors: Mapping[str, Mapping[str, float]], names: Sequence[str]) -> float:
    """Norm of the vector of the components' means."""
    return math.hypot(*(errors[name]["mean"] for name in names))


def _mean_sd(found: Mapping[str, float], digits: int = 2) -> str:
    return f"{found['mean']:.{digits}f} ({found['sd']:.{digits}f})"


def _with_unit(name: str) -> str:
    return name.replace("_", " [") + "]"


def _fig4(result: Mahler2014) -> Section:
    test, evaluation = held_out_of(result.table1.full)
    shown = Shown(result.table1.full.corrector, evaluation.clean, evaluation.cleaning, test)
    return replace(trajectories_section(shown), title="Fig. 4: held-out reaches")


def _fig5(result: Mahler2014) -> Section:
    rows = [[str(p["states"]), p["method"], *(f"{p[name]:.2f}" for name in (*NORMS, "seconds"))] for p in result.fig5]
    few, everything = (CLAIMS.printed["fig5_seconds"][name] for name in ("few", "all"))
    most = max(point["states"] for point in result.fig5)
    rows += [["460", "the paper's", "-", "-", f"{few:g}"]]
    rows += [["all", "the paper's", "-", "-", f"{everything:g}"]]
    table = TableData(
        ["training states", "method", "position [mm]", "rotation [deg]", "fit [s]"],
        rows,
        "Held-out reaches, samples that pass cleaning. Times: regression alone, hyperparameters included, one thread.",
    )
    chart = _training_curves(result.fig5, {460: few, most: everything})
    return Section("Fig. 5: how many training states", (), (table,), (chart,))


def _table2(result: Mahler2014) -> Section:
    reached = {
        (name, when): summary_of(landing[when])
        for name, landing in result.table2.items()
        for when in ("at_rest", "on_arrival")
    }
    at_rest = {name: reached[name, "at_rest"] for name in result.table2}
    printed = {name: landing["at_rest"] for name, landing in CLAIMS.printed["table2"].items()}

    def _rows(landings: Mapping[str, Any], digits: int) -> dict[str, list[str]]:
        return {
            name: [
                *(_mean_sd(found[c], digits) for c in POSITION),
                f"{_norm(found, POSITION):.2f}",
            ]
            for name, found in landings.items()
        }

    as_printed = TableData(
        ["correction", *map(_with_unit, POSITION), "norm [mm]"],
        paired(_rows(at_rest, 2), _rows(printed, 1)),
        "Absolute errors at rest, half a second after arrival, mean (SD).",
    )
    rows = []
    for (name, when), found in reached.items():
        cells = [cell for p in NORMS for cell in (_mean_sd(found[p]), f"{found[p]['repeatability']:.2f}")]
        rows.append([f"{name}, {when.replace('_', ' ')}", *cells])
    ours = TableData(
        ["correction, ours", "position [mm]", "repeatability", "rotation [deg]", "repeatability"],
        rows,
        "Mean (SD) of the distance of the tool's true pose from the desired one; repeatability is the RMS spread of a "
        "place's visits about their mean.",
    )
    words = [
        f"{result.scope.places} places, {result.scope.repetitions} visits each, in another order every time. "
        "The command is sent through the inverse kinematics, the servo loop and the transmission of the simulated arm, "
        "and the tool's true pose is compared with the desired one: no tracker noise is in these figures."
    ]
    chart = _visits({name: landing["at_rest"] for name, landing in result.table2.items()})
    return Section("Table II: the corrected command really sent", words, (as_printed, ours), (chart,))


def _limits(result: Mahler2014) -> Section:
    raw = result.limits[0]
    rows = [
        [
            limit["assumption"],
            *(f"{limit[norm]:.2f}" for norm in NORMS),
            *(f"{100 * limit[norm] / raw[norm]:.1f} %" for norm in NORMS),
        ]
        for limit in result.limits
    ]
    table = TableData(
        ["what the regression knows", "position [mm]", "rotation [deg]", "of raw", "of raw"],
        rows,
        "The same reaches without tracker faults; mean length of the error on held-out reaches.",
    )
    words = [
        "Two things cannot be learned from pose and velocity: the tracker's own noise, which is in the pose that is "
        "asked for, and the memory of the transmission: play and dry friction leave the arm where its past put it."
    ]
    return Section("What limits it", words, (table,))


def _training_curves(points: Sequence[Mapping[str, Any]], published_seconds: Mapping[int, float]) -> Chart:
    """Position error, rotation error and fitting time; the paper's times (by number of states, s) as crosses."""
    methods = {"exact": (Role.RAW, "exact posterior"), "sparse": (Role.CORRECTED, "inducing points (default)")}
    labels = {
        "position_mm": "position error [mm]",
        "rotation_deg": "rotation error [deg]",
        "seconds": "fitting time [s]",
    }
    panels = []
    for name, label in labels.items():
        series = []
        for method, (role, title) in methods.items():
            chosen = [point for point in points if point["method"] == method]
            states, values = ([point[key] for point in chosen] for key in ("states", name))
            series += [Series(title, mark, role, states, values, size=8.0) for mark in (Mark.LINE, Mark.DOTS)]
        if name == "seconds":
            papers = list(published_seconds), list(published_seconds.values())
            series.append(Series("the paper's", Mark.CROSSES, Role.INK, *papers, size=9.0))
        panels.append(Panel("training states", label, series, log_x=True, log_y=name == "seconds", height=220))
    caption = (
        "Error and fitting time by number of training states; the paper's second time is drawn at our full number."
    )
    return Chart(caption, panels, columns=2)


def _visits(errors: Mapping[str, FloatArray]) -> Chart:
    """Lengths of the errors `(repetitions, places, 6)` of each kind of command, on a logarithmic scale."""
    panels = []
    for columns, scale, label in (
        (slice(0, 3), 1e3, "position error [mm]"),
        (slice(3, 6), 180 / np.pi, "rotation error [deg]"),
    ):
        series = []
        for i, ((name, error), role) in enumerate(
            zip(errors.items(), (Role.RAW, Role.CORRECTED, Role.RIGID), strict=True)
        ):
            size = scale * np.linalg.norm(error[..., columns], axis=-1)
            x = np.broadcast_to(1 + np.arange(size.shape[1]) + 0.22 * (i - 1), size.shape)
            series.append(Series(name, Mark.DOTS, role, x.ravel(), size.ravel(), size=5.0))
        panels.append(Panel("place", label, series, log_y=True, height=240))
    return Chart("Errors at rest, a dot a visit.", panels, columns=2)
