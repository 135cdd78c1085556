"""`gpcorrect reproduce`: published studies, done again, each beside its own figures."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.cli.console import json_ready, out, print_json, progress_bar
from gpcorrect.cli.options import Json
from gpcorrect.reproduce import Scope, reproduce_mahler2014

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

    require_folder(output)
    scope = Scope.quick(reaches) if quick else Scope(reaches)
    with progress_bar(quiet=json) as progress:
        result = reproduce_mahler2014(scope, seed, progress)
    output.mkdir(exist_ok=True)
    write_mahler_report(result, output / "report.html")
    figures = json_ready(result.to_dict())
    with atomic_path(output / "reproduce.json") as path:
        path.write_text(json_text.dumps(figures, indent=2), encoding="utf-8")
    if json:
        print_json(figures)
    else:
        _show(figures, output)


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
