"""`gpcorrect discrepancy`: where simulation and recordings disagree, what is missing, and how much it explains."""

from __future__ import annotations

import json as json_text
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.cli.console import err, out, print_json, progress_bar
from gpcorrect.cli.options import Columns, Json, read_logs
from gpcorrect.discrepancy.resume import find_or_resume
from gpcorrect.discrepancy.run import RunSettings
from gpcorrect.discrepancy.words import channel_words, in_reader_units, number, verdict_sentence
from gpcorrect.sim import read_model, write_model

__all__ = ["discrepancy_app"]

discrepancy_app = typer.Typer(
    help="Find where a simulator and recordings disagree, name what is missing, and measure what the name explains.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


@discrepancy_app.command("run")
def run(
    model: Annotated[Path, typer.Option(help="What is known of the machine (TOML).", show_default=False)],
    log: Annotated[
        list[Path], typer.Option(help="Recording; repeat it for several sessions of one machine.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for report, page and model; made if absent.", show_default=False)
    ],
    columns: Columns = None,
    seed: Annotated[int, typer.Option(help="Seed of the split and of everything drawn.")] = 0,
    json: Json = False,
) -> None:
    """Name what is missing in a model, or say that nothing is, or that these data cannot tell.

    Writes report.json, report.html (needs no other file) and model.toml: the model with the named effects, ready for
    --model and for `gpcorrect simulate`. Ends with status 0 whatever the verdict, 2 for input that cannot be used.

    Finished stages stay in OUTPUT/stages. The same command, killed and given again, goes on from there; other data,
    another model or another seed start anew. The same inputs and seed give the same verdict.

    For example:

    gpcorrect discrepancy run --model nominal.toml --log monday.csv --log tuesday.csv --output missing/

    gpcorrect discrepancy run --model missing/model.toml --log friday.csv --output left/ --json
    """
    from gpcorrect.report import write_discrepancy_report  # the report's libraries are an extra: say so before the work

    require_folder(output)
    machine, recording = read_model(model), read_logs(log, columns)
    output.mkdir(exist_ok=True)
    with progress_bar(quiet=json) as progress:
        done = find_or_resume(recording, machine, RunSettings(seed=seed), output, progress)
    with atomic_path(output / "report.json") as path:
        path.write_text(json_text.dumps(done.report, indent=2), encoding="utf-8")
    write_model(done.model, output / "model.toml")
    write_discrepancy_report(done.report, done.evidence, done.model, output / "report.html")
    if done.kept:
        err.print(f"[yellow]note:[/] {output} already held this run, finished; only its files were written anew")
    if json:
        print_json(done.report)
    else:
        _show(done.report, output)


def _show(report: Mapping[str, Any], output: Path) -> None:
    out.print(f"[bold]{verdict_sentence(report)}[/]")
    out.print(_gap_table(report["gap"]))
    advice = report["next_experiment"]
    if advice is not None:
        pair = " from ".join(advice["separates"])
        out.print(f"next: {advice['run']}: {advice['expected_nats']:.0f} nats to tell {pair}, {advice['minutes']:.1f} min")
    out.print(f"page: {output / 'report.html'}   model: {output / 'model.toml'}")


def _gap_table(gaps: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(title="Measured - simulated on the sealed part, root mean square", title_justify="left", box=None, pad_edge=False)
    for column in ("", "before", "after", "noise", "closed"):
        table.add_column(column, justify="left" if not column else "right", no_wrap=True)
    for name, gap in gaps.items():
        scale, symbol = in_reader_units(1.0, gap["unit"])
        sizes = [number(None if gap[k] is None else scale * gap[k]) for k in ("before", "after", "noise")]
        closed = "–" if gap["closed"] is None else f"{100 * gap['closed']:.0f} %"
        table.add_row(f"{channel_words(name)} [{symbol}]".replace("[", r"\["), *sizes, closed)
    return table
