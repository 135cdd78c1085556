"""`gpcorrect reproduce`: published studies, done again, each beside its own figures."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from gpcorrect.atomic import atomic_path, make_folder
from gpcorrect.cli.console import json_ready, out, print_json, progress_bar
from gpcorrect.cli.options import Jobs, Json, Scheduler
from gpcorrect.parallel import workers
from gpcorrect.reproduce import PengScope, Scope, reproduce_mahler2014, reproduce_peng2024

__all__ = ["reproduce_app"]

reproduce_app = typer.Typer(help="Do a published study again on simulated data.", no_args_is_help=True)

DEFAULT_FOLDER = Path("mahler2014")


@reproduce_app.callback()
def _studies() -> None:
    """Do a published study again on simulated data."""


@reproduce_app.command()
def mahler2014(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for report.html and reproduce.json.")
    ] = DEFAULT_FOLDER,
    seed: Annotated[int, typer.Option(help="Seed of the recording and of everything random.")] = 0,
    reaches: Annotated[int, typer.Option(help="Reaches of the recording; the paper had 303.")] = Scope.reaches,
    quick: Annotated[bool, typer.Option("--quick", help="A small recording: every part, rough figures.")] = False,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Mahler et al. 2014: Tables I and II, Figs. 4 and 5 on a simulated RAVEN-II, beside the paper's figures.

    About two minutes; --quick takes half of one.

    Examples
    --------
    gpcorrect reproduce mahler2014 --output mahler2014

    gpcorrect reproduce mahler2014 --quick --json
    """
    from gpcorrect.report import write_mahler_report  # the report's libraries are an extra

    make_folder(output)
    scope = Scope.quick(reaches) if quick else Scope(reaches)
    with progress_bar(quiet=json) as progress, workers(jobs, scheduler):
        result = reproduce_mahler2014(scope, seed, progress)
    write_mahler_report(result, output / "report.html")
    figures = json_ready(result.to_dict())
    with atomic_path(output / "reproduce.json") as path:
        path.write_text(json_text.dumps(figures, indent=2), encoding="utf-8")
    if json:
        print_json(figures)
    else:
        _show(figures, output)


@reproduce_app.command()
def peng2024(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for reproduce.json.")] = Path("peng2024"),
    seed: Annotated[int, typer.Option(help="Seed of the recordings.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="A small study: every part, rough figures.")] = False,
    json: Json = False,
) -> None:
    """Peng et al.: joint calibration of a simulated RAVEN-II, by direction, sparsity, hours of use and homings.

    Errors are RMSE in deg, deg, mm. Roughly half an hour of one thread; --quick takes several minutes.

    Example: gpcorrect reproduce peng2024 --output peng2024
    """
    make_folder(output)
    with progress_bar(quiet=json) as progress:
        result = reproduce_peng2024(PengScope.quick() if quick else PengScope(), seed, progress)
    figures = json_ready(result)
    with atomic_path(output / "reproduce.json") as path:
        path.write_text(json_text.dumps(figures, indent=2), encoding="utf-8")
    if json:
        print_json(figures)
    else:
        _show_peng(figures, output)


def _show_peng(figures: dict[str, Any], output: Path) -> None:
    table = Table(title="Table I, RMSE by training direction (deg, deg, mm)", title_justify="left", box=None)
    rows = figures["table1"]
    for column in ("trained on", *next(iter(rows.values()))):
        table.add_column(column, no_wrap=True)
    for direction, row in rows.items():
        table.add_row(direction, *(_three(cell["mean"]) for cell in row.values()))
    out.print(table)
    published = figures["published"]
    out.print(f"published: raw {_three(published['raw_rmse'])}, offset {_three(published['fixed_offset_rmse'])}")
    for row in figures["fig5"]:
        out.print(f"sparsity 1/{row['sparsity']}, {row['minutes']:.1f} min: network {_three(row['network'])}")
        out.print(f"    ours {_three(row['gp'])}")
    for name, use in figures["fig6"].items():
        out.print(f"after 6 h {name}: {_three(use['rmse'][-1])} (fresh {_three(use['rmse'][0])})")
    for row in figures["fig9"]:
        out.print(f"{row['homings']} homings: {_three(row['as it was'])}; new zero {_three(row['new zero'])}")
    out.print(f"{figures['seconds']:.0f} s; figures: {output / 'reproduce.json'}")


def _three(values: list[float]) -> str:
    return " ".join(f"{value:.3f}" for value in values)


def _show(figures: dict[str, Any], output: Path) -> None:
    for which in ("clean", "dirty"):
        table = Table(title=f"Table I, {which} set", title_justify="left", box=None, pad_edge=False)
        for column in ("", "position [mm]", "SD", "rotation [deg]", "SD"):
            table.add_column(column, justify="right" if column else "left", no_wrap=True)
        for method, errors in figures["table1"][which].items():
            parts = (errors["position_mm"], errors["rotation_deg"])
            table.add_row(method, *(f"{part[leaf]:.2f}" for part in parts for leaf in ("mean", "sd")))
        out.print(table)
    for name, target in figures["targets"].items():
        out.print(
            f"{name}: {target['measured']:.1f} (target {target['target']:g}): {'met' if target['met'] else 'not met'}"
        )
    out.print(f"{figures['seconds']:.0f} s; page: {output / 'report.html'}   figures: {output / 'reproduce.json'}")
