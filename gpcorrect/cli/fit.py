"""`gpcorrect fit`: recordings in, model file out, with the errors on held-out trajectories."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from gpcorrect import artifact
from gpcorrect.atomic import atomic_path, make_folder, require_folder
from gpcorrect.cleaning import CleaningReport, CleaningSettings, Segment
from gpcorrect.cli.console import err, out, print_json, progress_bar, show_errors, split_names
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
from gpcorrect.corrector import FitSettings
from gpcorrect.errors import DataError
from gpcorrect.experiment import Experiment, run_experiment
from gpcorrect.rigid import MarkerOption

__all__ = ["fit"]


def fit(
    logs: Logs,
    output: Annotated[Path, typer.Option("--output", "-o", help="Model file to write.", show_default=False)],
    columns: Columns = None,
    features: Annotated[
        str,
        typer.Option(
            help="What the regression sees: pose or euler (the paper's angles), velocity, memory (of the path so far)."
        ),
    ] = "pose,velocity",
    clean: Annotated[bool, typer.Option("--clean/--no-clean", help="Reject faulty samples first.")] = True,
    keep: Annotated[
        list[str] | None,
        typer.Option(help="Never reject TRAJECTORY:START:STOP (s). Repeatable.", show_default=False),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option(help="Always reject TRAJECTORY:START:STOP (s). Repeatable.", show_default=False),
    ] = None,
    marker: Annotated[
        str, typer.Option(help="Marker is not the tool tip: none, solve, or auto (by held-out error).")
    ] = "auto",
    time_offset: Annotated[
        str,
        typer.Option(help="Tracker's clock: auto (shift what cannot be robot lag), none, or seconds it runs ahead."),
    ] = "auto",
    holdout: Annotated[float, typer.Option(help="Share of whole trajectories to measure on; 0 for none.")] = 0.2,
    shuffle: Annotated[
        bool, typer.Option("--shuffle", help="Hold out random trajectories, not the last ones.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of everything random.", min=0)] = 0,
    report: Annotated[
        Path | None,
        typer.Option(help="Folder for the report page and the list of dropped samples.", show_default=False),
    ] = None,
    namespace: Namespace = None,
    tracker_topic: Tracker = None,
    tracker_log: TrackerLog = None,
    arm: Arm = None,
    as_is: AsIs = False,
    drop_disordered: Disordered = False,
    json: Json = False,
) -> None:
    """Learn what to command from recordings, and measure it on trajectories that were held out.

    Examples
    --------
    gpcorrect fit monday.csv tuesday.csv --output model.gpc --report report/

    gpcorrect fit monday.csv --features pose,velocity,memory --output model.gpc

    gpcorrect fit lab.csv --columns map.toml --output model.gpc --json

    gpcorrect fit robot.bag --tracker-log "Take 2026-11-21.csv" --output model.gpc
    """
    require_folder(output)
    if report is not None:
        make_folder(report)
    settings = FitSettings(
        features=split_names(features),
        clean=clean,
        cleaning=CleaningSettings(keep=_segments(keep), drop=_segments(drop)),
        marker=_marker(marker),
        time_offset=clock_left(time_offset, tracker_log),
        seed=seed,
    )
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
    with progress_bar(quiet=json) as progress:
        experiment = run_experiment(log, settings, holdout=holdout, shuffle=shuffle, progress=progress)
    artifact.save(experiment.corrector, output)
    result = experiment.to_dict()
    if report is not None:
        _write_report(experiment, report)
    if json:
        print_json(result)
    else:
        _show(experiment, result, output, report)


def _marker(text: str) -> MarkerOption:
    """Return the option if it is one."""
    for option in get_args(MarkerOption):
        if text == option:
            chosen: MarkerOption = option
            return chosen
    raise DataError(f"the marker is one of {', '.join(get_args(MarkerOption))}; got {text!r}.")


def _segments(texts: list[str] | None) -> tuple[Segment, ...]:
    return tuple(_segment(text) for text in texts or ())


def _segment(text: str) -> Segment:
    try:
        trajectory, start, stop = text.split(":")
        return Segment(int(trajectory), float(start), float(stop))
    except ValueError as error:
        raise DataError(
            f"a segment is TRAJECTORY:START:STOP in seconds, got {text!r}.",
            hint="For example: --drop 3:12.5:14.0",
        ) from error


def _write_report(experiment: Experiment, folder: Path) -> None:
    from gpcorrect.report import write_fit_report  # the report's libraries are an extra

    write_fit_report(experiment, folder / "report.html")
    reports = [("train", experiment.fit.cleaning)]
    if experiment.evaluation is not None:
        reports.append(("held out", experiment.evaluation.cleaning))
    with atomic_path(folder / "cleaning.csv") as path:
        _write_dropped(reports, path)


def _write_dropped(reports: list[tuple[str, CleaningReport]], path: Path) -> None:
    rows: list[dict[str, Any]] = [{"set": name, **row} for name, r in reports for row in r.to_table()]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else ["set"])
        writer.writeheader()
        writer.writerows(rows)


def _show(experiment: Experiment, result: dict[str, Any], output: Path, report: Path | None) -> None:
    for remark in experiment.fit.remarks:
        err.print(f"[yellow]note:[/] {remark}")
    for caution in experiment.evaluation.cautions if experiment.evaluation else ():
        err.print(f"[yellow]caution:[/] {caution}")
    if result["errors"]:
        show_errors(f"Held-out error, {result['n_test']} samples that pass cleaning", result["errors"])
        show_errors("All held-out samples as they came", result["errors_dirty"])
        out.print(f"95 % intervals cover {100 * result['coverage95']:.1f} % of the held-out errors")
    dropped = ", ".join(f"{n} {why}" for why, n in result["dropped"].items() if n) or "none"
    out.print(f"trained on {result['n_train']} samples in {result['seconds']:.1f} s; dropped: {dropped}")
    out.print(f"model: {output}" + (f"   report: {report / 'report.html'}" if report else ""))
