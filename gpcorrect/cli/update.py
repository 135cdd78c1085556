"""`gpcorrect update`: new observations into a model, without a new fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gpcorrect import artifact
from gpcorrect.adaptation import Update
from gpcorrect.adaptation import update as update_model
from gpcorrect.atomic import require_folder
from gpcorrect.cli.console import err, out, print_json, progress_bar, show_errors
from gpcorrect.cli.options import Arm, AsIs, Columns, Disordered, Json, Logs, Namespace, Tracker, read_logs
from gpcorrect.corrector import on_one_clock

__all__ = ["update"]

NOT_WRITTEN = 1
UNSEEN = 0.2  # share of prior variance that points cannot see, from which a new fit is advised


def update(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    logs: Logs,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Model file to write; by default MODEL is replaced.", show_default=False),
    ] = None,
    columns: Columns = None,
    time_offset: Annotated[str, typer.Option(help="Tracker's clock, as for fit: auto, none, or seconds.")] = "auto",
    holdout: Annotated[float, typer.Option(help="Share of the new trajectories to measure on; 0 for none.")] = 0.2,
    force: Annotated[bool, typer.Option("--force", help="Write also where the held-out error grew.")] = False,
    as_is: AsIs = False,
    drop_disordered: Disordered = False,
    namespace: Namespace = None,
    tracker_topic: Tracker = None,
    arm: Arm = None,
    json: Json = False,
) -> None:
    """Add the observations of new recordings to a model; its size and the time of a query stay.

    Old and new model are measured on new trajectories that were held out. Where the error grew nothing is written
    (exit status 1) unless --force is given.

    Examples
    --------
    gpcorrect update model.gpc tuesday.csv

    gpcorrect update model.gpc tuesday.csv --output tuesday.gpc --json
    """
    target = output or model
    require_folder(target)
    corrector = artifact.load(model)
    log = read_logs(
        logs,
        columns,
        as_is=as_is,
        drop_disordered=drop_disordered,
        namespace=namespace,
        tracker_topic=tracker_topic,
        arm=arm,
    )
    log, _ = on_one_clock(log, time_offset)
    with progress_bar(quiet=json) as progress:
        found = update_model(corrector, log, holdout=holdout, progress=progress)
    written = force or not found.worse
    if written:
        artifact.save(found.corrector, target)
    if json:
        print_json(_result(found, target if written else None))
    else:
        _show(found, target, written=written)
    if not written:
        raise typer.Exit(NOT_WRITTEN)


def _result(found: Update, written: Path | None) -> dict[str, Any]:
    return {
        "n_added": found.n_added,
        "keep": found.keep,
        "unseen": found.unseen,
        "before": found.before.to_dict() if found.before else None,
        "after": found.after.to_dict() if found.after else None,
        "worse": list(found.worse),
        "output": None if written is None else str(written),
    }


def _show(found: Update, target: Path, *, written: bool) -> None:
    if found.before is not None and found.after is not None:
        for name, evaluation in (("before the update", found.before), ("after it", found.after)):
            errors = evaluation.clean.errors()
            show_errors(f"Held-out new trajectories, {name}", {"corrected": errors["corrected"]})
        shares = [100 * e.to_dict()["coverage95"] for e in (found.before, found.after)]
        out.print(f"95 % intervals cover {shares[0]:.1f} % before and {shares[1]:.1f} % after")
    else:
        err.print("[yellow]note:[/] nothing was held out, so nothing is known of the updated model's error")
    out.print(f"{found.n_added} samples added; the old data kept {100 * found.keep:.0f} % of their weight")
    if found.unseen > UNSEEN:
        err.print(
            f"[yellow]note:[/] the model's points cannot see {100 * found.unseen:.0f} % of the new motion: "
            "fit anew to old and new recordings to learn there"
        )
    if found.worse:
        err.print(f"[yellow]worse:[/] the held-out error grew in {' and '.join(found.worse)}")
    out.print(f"model: {target}" if written else "nothing was written; write all the same with --force")
