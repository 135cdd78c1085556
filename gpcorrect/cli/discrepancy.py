"""`gpcorrect discrepancy`: where simulation and recordings disagree, what is missing, and how much it explains."""

from __future__ import annotations

import json as json_text
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.atomic import make_folder, require_new, write_file
from gpcorrect.cli.console import note, out, plain_table, print_json, progress_bar, styled
from gpcorrect.cli.options import Columns, Jobs, Json, Scheduler, Seed, report_page
from gpcorrect.cli.reading import model_named, read_logs
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from rich.table import Table

    from gpcorrect.discrepancy.outcome.result import ChannelGap

discrepancy_app = typer.Typer(no_args_is_help=True)

# Signals that a run rests on: what they cannot be is refused as they are read.
LEARNED = ("setpoint_cp", "tracker_cp", "setpoint_jp", "measured_jp", "external_jp")


@discrepancy_app.command("run")
def run(
    machine: Annotated[
        str,
        typer.Option(
            "--machine",
            "--model",
            help="What is known of the machine: model file (TOML), robot file (MJCF, URDF), or a packaged one's name.",
        ),
    ],
    log: Annotated[list[Path], typer.Option(help="Recording; repeat it for several sessions of one machine.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report, page and model; made if absent.")],
    columns: Columns = None,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(help="Threads to spread the work over; -1 for one a core.")] = -1,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Name what is missing in a model, or say that nothing is, or that these data cannot tell.

    Writes report.json, report.html (needs no other file) and model.toml: the model with the named effects, ready for
    --machine and for `gpcorrect simulate`. With a robot file, model.xml is that file with the effects for which it has
    words (friction, damping, force limits, ranges, payload, link geometry), and model.toml names it and holds the
    others. Ends with status 0 whatever the verdict, 2 for input that cannot be used.

    Finished stages stay in OUTPUT/stages. The same command, killed and given again, goes on from there; other data,
    another model or another seed start anew. The same inputs and seed give the same verdict.

    For example:

    gpcorrect discrepancy run --machine nominal.toml --log monday.csv --log tuesday.csv --output missing/

    gpcorrect discrepancy run --machine missing/model.toml --log friday.csv --output left/ --json

    gpcorrect discrepancy run --machine robot.xml --log monday.csv --output missing/
    """
    from gpcorrect.discrepancy import find_discrepancy
    from gpcorrect.discrepancy.outcome.sentences import next_step, verdict_sentences
    from gpcorrect.parallel import workers
    from gpcorrect.report import write_discrepancy_report  # the report's libraries are an extra: say so before the work
    from gpcorrect.sim.model import write_completed

    models = [output / "model.toml", output / "model.xml"]
    if any(path.exists() and path.resolve() == Path(machine).resolve() for path in models):
        raise DataError(f"the completed model would be written over {machine}.", hint="Name another --output.")
    make_folder(output)
    report_page(output / "report.html")
    if not (output / "stages").exists():  # of an earlier run, whose files are written again
        for path in (*models, output / "report.json"):
            require_new(path)
    model, recording = model_named(machine), read_logs(log, columns, learned=LEARNED)
    note(*recording.remarks)
    with progress_bar(quiet=json) as progress, workers(jobs, scheduler, threads=True):
        result = find_discrepancy(model, recording, seed=seed, progress=progress, stages=output / "stages")
    report = result.to_report()
    write_file(output / "report.json", json_text.dumps(report, indent=2))
    written = write_completed(result.model, output / "model.toml")
    write_discrepancy_report(result, output / "report.html")
    if result.read_back:
        note(f"{output} already held this run, finished; only its files were written anew")
    if json:
        print_json(report)
        return
    headline, *beside = verdict_sentences(result)
    out.print(styled((headline, "bold"), *(f" {sentence}" for sentence in beside)))
    out.print(_gap_table(result.gap))
    out.print(f"next: {next_step(result)}")
    robot = "" if written.robot is None else f"   robot: {written.robot}"
    out.print(f"page: {output / 'report.html'}   model: {written.model}{robot}")


def _gap_table(gaps: Sequence[ChannelGap]) -> Table:
    from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units, number

    title = "Measured - simulated on the test set, root mean square"
    table = plain_table("", "before", "after", "noise", "closed", title=title)
    for gap in gaps:
        scale, symbol = in_reader_units(1.0, gap.channel.unit)
        sizes = [number(scale * size) for size in (gap.before, gap.after, gap.noise)]
        closed = f"{100 * min(gap.closed, 1.0):.0f} %" if isfinite(gap.closed) else "–"
        table.add_row(f"{channel_words(gap.channel)} [{symbol}]", *sizes, closed)
    return table


@discrepancy_app.command("generate")
def generate(
    spec: Annotated[Path, typer.Option(help="What to simulate and what to hide (TOML).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the logs; made if absent.")],
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Simulate recordings with hidden effects, and seal the labels apart from them.

    Writes nominal.toml (what the workflow is given), a log a case, labels.sha256, and sealed/labels.json: keep that
    folder from whoever is tested, the hash shows later that it was not changed.

    For example, spec.toml, beside a nominal.toml that has a [noise] table (all keys: docs/discrepancy.md):

    model = "nominal.toml"

    motion = { trajectories = 24, seconds = 20.0, payloads = [0.0, 0.3] }

    cases = [{ repeat = 5 }, { effects = [{ name = "cable_stretch", joint = 2, stiffness = 120.0 }] }]

    draw = { cases = 20, effect_to_noise = [2.0, 1.0], names = [] }

    Here: five recordings in which nothing is missing, one with a cable stretch, twenty with an effect drawn at random.

    gpcorrect discrepancy generate --spec spec.toml --output blind/
    """
    from gpcorrect.discrepancy.protocol.generate import LABELS, label_of, read_spec, seal
    from gpcorrect.discrepancy.protocol.generate import generate as generate_cases
    from gpcorrect.logs import write_log
    from gpcorrect.logs.reader import recording_digest
    from gpcorrect.parallel import workers
    from gpcorrect.sim import read_model, write_model

    make_folder(output)
    wanted, nominal = read_spec(spec), output / "nominal.toml"
    require_new(output / LABELS)
    known = nominal.exists() and read_model(nominal) == wanted.model  # the file that the spec names, by hand
    if not known:
        require_new(nominal)
    labels: dict[str, Any] = {}
    with progress_bar(quiet=json) as progress, workers(jobs, scheduler):
        for case in generate_cases(wanted, progress):
            path = output / f"{case.name}.parquet"
            write_log(case.log, path)
            labels[case.name] = label_of(case, recording_digest(path))
    if not known:
        write_model(wanted.model, nominal)
    digest = seal({"cases": labels}, output)
    if json:
        print_json({"cases": sorted(labels), "labels": str(output / LABELS / "labels.json"), "sha256": digest})
    else:
        out.print(f"{len(labels)} logs -> {output}; labels sealed in {output / LABELS} (SHA-256 {digest[:16]}...)")


@discrepancy_app.command("score")
def score(
    labels: Annotated[Path, typer.Option(help="labels.json of `generate`.")],
    reports: Annotated[list[Path], typer.Option(help="Output folder of `run`, or a folder of them. Repeatable.")],
    json: Json = False,
) -> None:
    """Hold reports against sealed labels: target table with Wilson intervals, confusion matrix, detection limits.

    Rows of the matrix are what was hidden, columns what was reported; columns besides the names: set (one of
    several, the truth among them), wrong set, unknown, inconclusive, none. A detection limit is the smallest
    effect-to-noise ratio from which on at least 70 % of an effect's cases are named exactly.

    For example:

    gpcorrect discrepancy score --labels blind/sealed/labels.json --reports runs/
    """
    from gpcorrect.discrepancy.protocol.score_reports import read_labels, read_reports, score_reports, score_text

    found = score_reports(read_labels(labels), read_reports(reports))
    if json:
        print_json(found.to_dict())
        return
    out.print(score_text(found))
