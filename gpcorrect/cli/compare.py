"""`gpcorrect compare`: two models measured on the same samples of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gpcorrect.cli.console import note, out, plain_table, print_json
from gpcorrect.cli.options import Json, Logs, Report, report_page, takes_groups
from gpcorrect.cli.reading import Reading

Model = Annotated[Path, typer.Argument(help="Model file that a fit wrote.", show_default=False)]


@takes_groups
def compare(one: Model, other: Model, logs: Logs, reading: Reading, report: Report = None, json: Json = False) -> None:
    """Measure two models of one task on the same samples of recordings: errors, intervals, domain, side by side.

    Example: gpcorrect compare monday.gpc tuesday.gpc wednesday.csv --report compare.html
    """
    from gpcorrect.calibration import load_any, measure_both, refuse_unlike

    page = None if report is None else report_page(report)
    first, second = load_any(one), load_any(other)
    names = (one.stem, other.stem) if one.stem != other.stem else (str(one), str(other))
    refuse_unlike(first, second, names)
    log = reading.joint_log(logs) if first.TASK == "joints" else reading.log(logs)
    log, clocks = first.on_one_clock(log, reading.clock_left)
    both = measure_both(first, second, log)
    figures = both.to_dict(names)
    for sentence in clocks.notes:
        note(sentence)
    for model in figures["models"]:
        for caution in model["cautions"]:
            note(f"{model['name']}: {caution}")
    if page is not None:
        from gpcorrect.report import write_compare_report  # the report's libraries are an extra

        write_compare_report(both, names, clocks.notes, page)
    if json:
        print_json(figures)
        return
    _show(figures, [f"{p.name} [{p.unit}]" for p in both.parts])
    for difference in both.differences():
        out.print(difference.sentence(names))
    if page is not None:
        out.print(f"report: {page}")


def _show(figures: dict[str, Any], parts: list[str]) -> None:
    title = f"Errors on the {figures['samples']} samples that pass the cleaning of both"
    table = plain_table("model", "part", "", "mean", "SD", "rmse", "p95", "max", "", title=title, left=3)
    for model in figures["models"]:
        for row in model["errors"]:
            leaves = [f"{row[leaf]:.3f}" for leaf in ("mean", "sd", "rmse", "p95", "max")]
            table.add_row(model["name"], row["part"], row["method"], *leaves, row["unit"])
    out.print(table)
    names = [model["name"] for model in figures["models"]]
    columns = [f"{part} {name}" for part in parts for name in names]
    table = plain_table(
        "trajectory", "samples", *columns, *(f"in domain {name}" for name in names), title="Mean errors"
    )
    for row in figures["trajectories"]:
        means = [f"{mean:.3f}" for pair in row["mean"].values() for mean in pair]
        table.add_row(
            str(row["trajectory"]), str(row["samples"]), *means, *(f"{100 * near:.1f} %" for near in row["in_domain"])
        )
    out.print(table)
    for model in figures["models"]:
        covered, near = 100 * model["coverage95"], 100 * model["in_domain"]
        out.print(f"{model['name']}: 95 % intervals cover {covered:.1f} %; {near:.1f} % in domain")
