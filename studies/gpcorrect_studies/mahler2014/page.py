"""The page of `gpcorrect reproduce mahler2014`: the paper's tables and figures made again, beside its own numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.plots import trajectory_errors, trajectory_paths, typical_trajectory
from gpcorrect.plots.style import COLOURS, new_figure, png
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect.types import FloatArray
from gpcorrect_studies.mahler2014.regressions import TrainingSize
from gpcorrect_studies.mahler2014.study import COMPARABLE, NOT_COMPARABLE, Mahler2014
from gpcorrect_studies.mahler2014.table1 import COMPONENTS, FULL, METHODS, NORMS
from gpcorrect_studies.published import MAHLER_2014, MAHLER_MISSING

__all__ = ["write_mahler_report"]

TITLES = {
    "position_percent_of_raw_dirty": "position error after full correction, of the uncorrected one",
    "rotation_percent_of_raw_dirty": "rotation error after full correction, of the uncorrected one",
    "position_percent_of_raw_dirty_memory": "the same with memory of the commands, which the paper has not: position",
    "rotation_percent_of_raw_dirty_memory": "the same with memory of the commands, which the paper has not: rotation",
    "position_gain_of_velocity": "position error that velocity features take away",
    "rotation_gain_of_velocity": "rotation error that velocity features take away",
    "position_gain_of_cleaning_on_sd": "spread of the position error that cleaning takes away",
    "rotation_gain_of_cleaning_on_sd": "spread of the rotation error that cleaning takes away",
}
HEADS = {name: name.replace("_", " [") + "]" for name in (*COMPONENTS, *NORMS)}


def write_mahler_report(result: Mahler2014, path: Path) -> None:
    """Write the self-contained page.

    Parameters
    ----------
    result : Mahler2014
        The whole study.
    path : Path
        HTML file.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    percent, met = result.table1.percent_of_raw("dirty"), [target["met"] for target in result.targets().values()]
    verdict = (
        f"Full correction leaves {percent['position_mm']:.1f} % of the position error and "
        f"{percent['rotation_deg']:.1f} % of the rotation error on the dirty set; the paper left "
        f"{_value('position_percent_of_raw_dirty')} % and {_value('rotation_percent_of_raw_dirty')} %. "
        f"{sum(met)} of {len(met)} targets are met."
    )
    facts = [
        ("recording", f"simulated: {result.scope.reaches} reaches, {result.samples} samples, seed {result.seed}"),
        ("held out", "the last fifth of the reaches, whole"),
        ("time", f"{result.seconds:.0f} s for everything on this page"),
    ]
    sections = [
        _comparison(result),
        _table1(result),
        _fig4(result),
        _fig5(result),
        _table2(result),
        _limits(result),
        Section("What is comparable", COMPARABLE),
        Section("What is not", NOT_COMPARABLE),
    ]
    write_page(Page("gpcorrect reproduce mahler2014", verdict, facts, sections), path)


def _value(name: str) -> float:
    return MAHLER_2014[name].values[0]


def _comparison(result: Mahler2014) -> Section:
    measured = result.targets()
    gain = result.table1.gain_of_velocity("dirty")["rotation_deg"]
    rows = [
        [
            TITLES[name],
            f"{t['measured']:.1f} %",
            _published(name),
            _bound(name, t["target"]),
            "yes" if t["met"] else "no",
        ]
        for name, t in measured.items()
    ]
    rows.insert(
        3, [TITLES["rotation_gain_of_velocity"], f"{gain:.1f} %", _published("rotation_gain_of_velocity"), "", ""]
    )
    table = TableData(
        ["dirty set", "here", "the paper", "target", "met"],
        rows,
        "Means of the error's length. Sources of the paper's figures: "
        + "; ".join(f"{TITLES[n]}: {MAHLER_2014[n].source}" for n in TITLES if n in MAHLER_2014)
        + ". The paper's gains by velocity are of its own, unnamed set.",
    )
    return Section("Beside the paper", [f"Not at hand, and so not compared: {'; '.join(MAHLER_MISSING)}."], (table,))


def _published(name: str) -> str:
    if name.endswith("memory"):
        return "none"
    return f"{_value(name):g} {MAHLER_2014[name].unit}" if name in MAHLER_2014 else "-"


def _bound(name: str, target: float) -> str:
    if "percent_of_raw" in name:
        return f"at most {target:g} %"
    return f"at least {target:g} %" if target else "less spread"


def _table1(result: Mahler2014) -> Section:
    def _rows(which: str, names: Sequence[str]) -> list[list[str]]:
        errors = result.table1.errors[which]
        return [
            [method, *(f"{errors[method][n]['mean']:.2f} ± {errors[method][n]['sd']:.2f}" for n in names)]
            for method in METHODS
        ]

    tables = [
        TableData([f"{which} set", *(HEADS[n] for n in names)], _rows(which, names), f"Mean ± SD over {whole}.")
        for which, whole in (("clean", "samples that pass cleaning"), ("dirty", "all samples as they came"))
        for names in (NORMS, COMPONENTS)
    ]
    quoted = [
        [method, *(f"{_value(f'{part}_{when}'):g}" for part in ("position", "rotation"))]
        for method, when in (("no correction", "raw"), (FULL, "corrected"))
    ]
    note = "The paper's abstract: norm of the mean position error and of the mean angular error, held-out trajectories."
    tables.append(TableData(["the paper", "position [mm]", "rotation [deg]"], quoted, note))
    words = [
        "Absolute errors of the command that each method would have given for the observed pose. Roll, pitch and yaw "
        "are differences of angles about fixed axes, as the paper's; rotation is the angle of the whole error.",
        "All methods but the last learn from the recording as it came, faults included.",
    ]
    return Section("Table I: six methods", words, tables)


def _fig4(result: Mahler2014) -> Section:
    full = result.table1.full
    assert full.evaluation is not None
    assert full.test is not None
    measured = full.evaluation.clean
    number = typical_trajectory(measured, full.test)
    captions = (
        "What each method would have commanded on the held-out reach with the median error, and what was commanded.",
        "Error of the fully corrected command on the same reach, and its 95 % interval.",
    )
    drawn = (trajectory_paths, trajectory_errors)
    figures = [
        FigureImage(png(draw(measured, full.test, number)), caption)
        for draw, caption in zip(drawn, captions, strict=True)
    ]
    return Section("Fig. 4: a held-out reach", (), (), figures)


def _fig5(result: Mahler2014) -> Section:
    rows = [
        [str(p.states), p.method, f"{p.position_mm:.2f}", f"{p.rotation_deg:.2f}", f"{p.seconds:.2f}"]
        for p in result.fig5
    ]
    few, everything = _value("fit_seconds_460_states"), _value("fit_seconds_all_states")
    most = max(point.states for point in result.fig5)
    rows += [["460", "the paper's", "-", "-", f"{few:g}"]]
    rows += [["all", "the paper's", "-", "-", f"{everything:g}"]]
    table = TableData(
        ["training states", "method", "position [mm]", "rotation [deg]", "fit [s]"],
        rows,
        "Held-out reaches, samples that pass cleaning. Times: regression alone, hyperparameters included, one thread.",
    )
    figure = FigureImage(
        png(_training_curves(result.fig5, {460: few, most: everything})),
        "Error and fitting time by number of training states; the paper's second time is drawn at our full number.",
    )
    return Section("Fig. 5: how many training states", (), (table,), (figure,))


def _table2(result: Mahler2014) -> Section:
    rows = []
    for name, landing in result.table2.items():
        for when, reached in (("at rest", landing.at_rest), ("on arrival", landing.on_arrival)):
            f = reached.to_dict()
            cells = [
                cell
                for part in NORMS
                for cell in (f"{f[f'{part}_mean']:.2f} ± {f[f'{part}_sd']:.2f}", f"{f[f'{part}_repeatability']:.2f}")
            ]
            rows.append([f"{name}, {when}", *cells])
    table = TableData(
        ["correction", "position [mm]", "repeatability", "rotation [deg]", "repeatability"],
        rows,
        "Mean ± SD of the distance of the tool's true pose from the desired one; repeatability is the RMS spread of a "
        "place's visits about their mean. At rest: half a second after arrival.",
    )
    words = [
        f"{result.scope.places} places, {result.scope.repetitions} visits each, in another order every time. "
        "The command is sent through the inverse kinematics, the servo loop and the transmission of the simulated arm, "
        "and the tool's true pose is compared with the desired one: no tracker noise is in these figures.",
    ]
    figure = FigureImage(
        png(_visits({name: landing.at_rest.error for name, landing in result.table2.items()})),
        "Errors at rest, a dot a visit.",
    )
    return Section("Table II: the corrected command really sent", words, (table,), (figure,))


def _limits(result: Mahler2014) -> Section:
    raw = result.limits[0]
    rows = [
        [
            limit.assumption,
            *(f"{v:.2f}" for v in (limit.position_mm, limit.rotation_deg)),
            f"{100 * limit.position_mm / raw.position_mm:.1f} %",
            f"{100 * limit.rotation_deg / raw.rotation_deg:.1f} %",
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
        "asked for, and the memory of the transmission: play and dry friction leave the arm where its past put it.",
    ]
    return Section("What limits it", words, (table,))


def _training_curves(points: Sequence[TrainingSize], published_seconds: Mapping[int, float]) -> Figure:
    """Position error, rotation error and fitting time; the paper's times (by number of states, s) as crosses."""
    styles = {"exact": ("raw", "o", "exact posterior"), "sparse": ("corrected", "s", "inducing points (default)")}
    figure, axes = new_figure(9.5, 3.2, 1, 3)
    quantities = (
        ("position_mm", "position error [mm]"),
        ("rotation_deg", "rotation error [deg]"),
        ("seconds", "fitting time [s]"),
    )
    for ax, (name, label) in zip(axes, quantities, strict=True):
        for method, (colour, marker, title) in styles.items():
            chosen = [point for point in points if point.method == method]
            states, values = [point.states for point in chosen], [getattr(point, name) for point in chosen]
            ax.plot(states, values, color=COLOURS[colour], marker=marker, markersize=4, linewidth=1.4, label=title)
        ax.set(xscale="log", xlabel="training states", ylabel=label)
        if name != "seconds":
            ax.set_ylim(0, 1.15 * max(getattr(point, name) for point in points))
    axes[2].plot(
        list(published_seconds), list(published_seconds.values()), "x", color=COLOURS["ink"], label="the paper's"
    )
    axes[2].set_yscale("log")
    axes[2].legend(frameon=False, fontsize=7)
    return figure


def _visits(errors: Mapping[str, FloatArray]) -> Figure:
    """Lengths of the errors `(repetitions, places, 6)` of each kind of command, on a logarithmic scale."""
    figure, axes = new_figure(9.5, 3.4, 1, 2)
    quantities = ((slice(0, 3), 1e3, "position error [mm]"), (slice(3, 6), 180 / np.pi, "rotation error [deg]"))
    for ax, (columns, scale, label) in zip(axes, quantities, strict=True):
        for i, ((name, error), shade) in enumerate(zip(errors.items(), ("raw", "corrected", "rigid"), strict=True)):
            size = scale * np.linalg.norm(error[..., columns], axis=-1)
            x = np.broadcast_to(1 + np.arange(size.shape[1]) + 0.22 * (i - 1), size.shape)
            ax.plot(x.ravel(), size.ravel(), ".", color=COLOURS[shade], markersize=5, alpha=0.75, label=name)
        ax.set(xlabel="place", ylabel=label, yscale="log", xticks=range(1, size.shape[1] + 1))
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    return figure
