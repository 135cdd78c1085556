"""`gpcorrect reproduce`: published studies, done again, each beside its own figures."""

from __future__ import annotations

import json as json_text
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from gpcorrect.atomic import make_folder, require_own, write_file
from gpcorrect.cli.console import note, out, plain_table, print_json, progress_bar
from gpcorrect.cli.options import Jobs, Json, Scheduler, Seed, report_page
from gpcorrect.errors import DataError
from gpcorrect.parallel import workers
from gpcorrect.plain import json_ready

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from gpcorrect_studies.claims import StudyResult

CLAIM_WIDTH = 60
"""Characters of a claim on one line: with the figures beside it, some 100."""

reproduce_app = typer.Typer(help="Do a published study again on simulated data.", no_args_is_help=True)

Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for report.html and reproduce.json.")]
Short = Annotated[bool, typer.Option("--short", help="Less of every part; meant for four minutes of processor time.")]
Quick = Annotated[bool, typer.Option("--quick", help="Little of every part; meant for one minute of processor time.")]


@reproduce_app.command()
def mahler2014(
    output: Output = Path("mahler2014"),
    seed: Seed = 0,
    reaches: Annotated[
        int | None, typer.Option(help="Reaches of the recording of the whole study; 303 without it, as in the paper.")
    ] = None,
    short: Short = False,
    quick: Quick = False,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Mahler et al. 2014: Tables I and II, Figs. 4 and 5 on a simulated RAVEN-II, beside the paper's figures.

    Every claim of the paper gets a verdict. Without --short or --quick the whole study is done, on 303 reaches.

    Examples
    --------
    gpcorrect reproduce mahler2014 --output mahler2014

    gpcorrect reproduce mahler2014 --quick --json
    """
    from gpcorrect_studies.mahler2014 import Scope, reproduce_mahler2014
    from gpcorrect_studies.mahler2014.page import write_mahler_report  # the report's libraries are an extra

    scope = _scope(Scope, short=short, quick=quick)
    if reaches is not None:
        if scope != Scope():
            raise DataError("--reaches goes with the whole study.", hint="Leave out --short and --quick, or --reaches.")
        scope = Scope(reaches)
    with workers(jobs, scheduler):
        _reproduce(reproduce_mahler2014, write_mahler_report, _show_mahler2014, scope, seed, output, json=json)


@reproduce_app.command()
def peng2020(
    output: Output = Path("peng2020"),
    seed: Seed = 0,
    short: Short = False,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Peng et al. 2020: accuracy of four webcams on rendered pictures (Table I), and of the position estimator.

    Every claim of the paper gets a verdict. The whole study takes some three minutes of processor time.

    Example: gpcorrect reproduce peng2020 --quick
    """
    from gpcorrect_studies.peng2020 import Peng2020Scope, reproduce_peng2020
    from gpcorrect_studies.peng2020.page import write_peng2020_report  # the report's libraries are an extra

    scope = _scope(Peng2020Scope, short=short, quick=quick)
    _reproduce(reproduce_peng2020, write_peng2020_report, _show_peng2020, scope, seed, output, json=json)


@reproduce_app.command()
def peng2024(
    output: Output = Path("peng2024"),
    seed: Seed = 0,
    short: Short = False,
    quick: Quick = False,
    as_published: Annotated[
        bool, typer.Option("--as-published", help="J1-J2-J3 as the study's published files drive it, not its Eq. (3).")
    ] = False,
    json: Json = False,
) -> None:
    """Peng et al. 2024: joint calibration of a simulated RAVEN-II, every table and figure beside the paper's figures.

    Every claim of the paper gets a verdict. Errors are RMSE in deg, deg, mm. The whole study takes several times as
    long as --short.

    Examples
    --------
    gpcorrect reproduce peng2024 --output peng2024

    gpcorrect reproduce peng2024 --short --json
    """
    from gpcorrect_studies.peng2024 import PengScope, reproduce_peng2024
    from gpcorrect_studies.peng2024.page import write_peng_report  # the report's libraries are an extra

    scope = _scope(PengScope, short=short, quick=quick)
    _reproduce(
        reproduce_peng2024, write_peng_report, _show_peng2024, scope, seed, output, json=json, as_published=as_published
    )


def _scope(scopes: Any, *, short: bool, quick: bool) -> Any:
    """Return how much of a study is done: the whole, or one of two smaller sizes."""
    if short and quick:
        raise DataError("--short and --quick are two sizes of a run.", hint="Give one of them.")
    return scopes.quick() if quick else scopes.short() if short else scopes()


def _reproduce(
    study: Callable[..., StudyResult],
    write_page: Callable[[Any, Path], None],
    show: Callable[[dict[str, Any]], None],
    scope: DataclassInstance,
    seed: int,
    output: Path,
    *,
    json: bool,
    **choices: bool,
) -> None:
    """Do a study, going on with what an earlier run of the same left in the folder; write page and figures."""
    from gpcorrect_studies.parts import Parts

    make_folder(output)
    page = output / "report.html"
    report_page(page)
    require_own(output / "reproduce.json", rb"{", "figures of a study")
    parts = Parts(output / "parts.jsonl", {"study": study.__name__, "scope": asdict(scope), "seed": seed, **choices})
    if parts.count:
        note(f"goes on with an earlier run: {parts.count} parts are done ({parts.seconds_before:.0f} s).")
    with progress_bar(quiet=json) as progress:
        result = study(scope, seed, progress, parts, **choices)
    write_page(result, page)
    figures = json_ready(result.to_dict())
    write_file(output / "reproduce.json", json_text.dumps(figures, indent=2))
    parts.remove()
    if json:
        print_json(figures)
        return
    show(figures)
    _show_claims(figures)
    out.print(f"{figures['seconds']:.0f} s; page: {page}   figures: {output / 'reproduce.json'}")


def _show_claims(figures: dict[str, Any]) -> None:
    from gpcorrect_studies.claims_page import number

    table = Table(title="Claims of the paper", title_justify="left", box=None, pad_edge=False)
    table.add_column("claim", max_width=CLAIM_WIDTH)
    for column in ("printed", "ours", "verdict"):
        table.add_column(column, no_wrap=True, justify="left" if column == "verdict" else "right")
    for row in figures["claims"]:
        ours = "-" if row["ours"] is None else number(row["ours"])
        table.add_row(f"{row['where']}: {row['claim']}", number(row["printed"]), ours, row["verdict"])
    out.print(table)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in figures["counts"].items() if count)
    out.print(f"{'A short run, not the whole study. ' if figures['short'] else ''}Claims: {counts}.")


def _show_mahler2014(figures: dict[str, Any]) -> None:
    for which in ("clean", "dirty"):
        table = plain_table("", "position (mm)", "SD", "rotation (deg)", "SD", title=f"Table I, {which} set")
        for method, errors in figures["table1"][which].items():
            parts = (errors["position_mm"], errors["rotation_deg"])
            table.add_row(method, *(f"{part[leaf]:.2f}" for part in parts for leaf in ("mean", "sd")))
        out.print(table)
    for name, target in figures["targets"].items():
        met = "met" if target["met"] else "not met"
        out.print(f"{name}: {target['measured']:.1f} (target {target['target']:g}): {met}")


def _show_peng2020(figures: dict[str, Any]) -> None:
    parts = ("x_mm", "y_mm", "z_mm", "length_mm")
    title = "Table I: where the cameras see the tool, RMS and SD in mm"
    table = plain_table("", "x", "y", "z", "3D", title=title)
    for name, row in figures["table1"].items():
        for leaf in ("rms", "sd"):
            table.add_row(f"{name}, {leaf.upper()}", *(f"{row[part][leaf]:.3f}" for part in parts))
    out.print(table)
    out.print(f"cameras placed within {max(figures['cameras_mm']):.2f} mm")
    title = "Estimator on held-out reaches: RMS in mm, time of a sample in us"
    rows = plain_table("", "raw", "rigid", "RMS", "RMS less", "SD less", "us", title=title)
    for method, row in figures["estimator"].items():
        errors = [f"{row[name]['rms_mm']:.3f}" for name in ("raw", "rigid", "estimated")]
        less = [f"{row[name]:.1f} %" for name in ("rms_reduction", "sd_reduction")]
        rows.add_row(method, *errors, *less, f"{row['microseconds_a_sample']:.0f}")
    out.print(rows)


def _show_peng2024(figures: dict[str, Any]) -> None:
    rows = figures["table1"]
    table = plain_table("", *rows, title="Table I, RMSE by training direction (deg, deg, mm)")
    for method in next(iter(rows.values())):
        table.add_row(method, *(_three(row[method]["mean"]) for row in rows.values()))
    out.print(table)
    for point in figures["fig5"]:
        both = (
            f"{name} {_three(point['rmse'][key]['mean'])}" for name, key in (("network", "network"), ("ours", "gp"))
        )
        out.print(f"sparsity 1/{point['sparsity']}, {point['minutes']:.1f} min: {', '.join(both)}")
    for name, target in figures["targets"].items():
        met = ", ".join("met" if one else "not met" for one in target["met"])
        out.print(f"{name}: {_three(target['measured'])} (target below {_three(target['target'])}): {met}")


def _three(values: list[float]) -> str:
    return " ".join(f"{value:.3f}" for value in values)
