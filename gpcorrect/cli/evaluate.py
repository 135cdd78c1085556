"""`gpcorrect evaluate`: measure a saved model on other logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gpcorrect import artifact
from gpcorrect.cli.console import err, out, print_json, show_errors
from gpcorrect.cli.options import (
    Arm,
    AsIs,
    Columns,
    Disordered,
    Json,
    Logs,
    Namespace,
    Tracker,
    TrackerLog,
    clock_left,
    read_logs,
)
from gpcorrect.corrector import on_one_clock
from gpcorrect.experiment import evaluate as evaluate_model

__all__ = ["evaluate"]


def evaluate(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    logs: Logs,
    columns: Columns = None,
    time_offset: Annotated[str, typer.Option(help="Tracker's clock, as for fit: auto, none, or seconds.")] = "auto",
    namespace: Namespace = None,
    tracker_topic: Tracker = None,
    tracker_log: TrackerLog = None,
    arm: Arm = None,
    as_is: AsIs = False,
    drop_disordered: Disordered = False,
    json: Json = False,
) -> None:
    """Measure a model on recordings it has not seen: errors before, after the rigid part, and corrected.

    Example: gpcorrect evaluate model.gpc tuesday.csv wednesday.bag
    """
    corrector = artifact.load(model)
    log = read_logs(
        logs,
        columns,
        as_is=as_is,
        drop_disordered=drop_disordered,
        namespace=namespace,
        tracker_topic=tracker_topic,
        arm=arm,
        tracker_log=tracker_log,
        time_offset=time_offset,
    )
    log, clocks = on_one_clock(log, clock_left(time_offset, tracker_log))
    measured = evaluate_model(corrector, log)
    result = {
        "n_test": len(measured.clean.rows),
        "dropped": dict(measured.cleaning.counts),
        **measured.to_dict(),
    }
    if json:
        print_json(result)
        return
    if clocks.applied:
        err.print(f"[yellow]note:[/] {clocks.remark}")
    show_errors(f"{result['n_test']} samples that pass cleaning", result["errors"])
    show_errors(f"all {len(measured.dirty.rows)} samples as they came", result["errors_dirty"])
    out.print(f"95 % intervals cover {100 * result['coverage95']:.1f} %; {100 * result['in_domain']:.1f} % in domain")
