"""`gpcorrect fit`, `evaluate` and `compare`: recordings in, models out, and errors on what they have not seen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from gpcorrect.atomic import require_new
from gpcorrect.cli import console
from gpcorrect.cli import options as opt
from gpcorrect.cli.reading import Reading
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect.calibration import Experiment
    from gpcorrect.cleaning import Segment


def fit(
    logs: opt.Logs,
    output: opt.ModelOutput,
    reading: Reading,
    features: Annotated[
        str | None,
        typer.Option(
            help="What the regression sees: pose or euler (the paper's angles), velocity, memory (of the path so far), "
            "joints (the arm's own, and their memory). By default pose and velocity, and joints or memory if they help."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="How to learn what the registration leaves, as in joint fit.")] = "gp",
    clean: opt.Clean = True,
    keep: Annotated[list[str] | None, typer.Option(help="Never reject TRAJECTORY:START:STOP (s). Repeatable.")] = None,
    drop: Annotated[list[str] | None, typer.Option(help="Always reject TRAJECTORY:START:STOP (s). Repeatable.")] = None,
    marker: Annotated[
        str, typer.Option(help="Marker is not the tool tip: none, solve, or auto (by held-out error).")
    ] = "auto",
    holdout: opt.Holdout = 0.2,
    hold_out_by: opt.HoldOutBy = "auto",
    shuffle: Annotated[
        bool, typer.Option("--shuffle", help="Hold out random trajectories, not the last ones.")
    ] = False,
    seed: opt.Seed = 0,
    report: opt.Report = None,
    json: opt.Json = False,
) -> None:
    """Learn what to command from recordings, and measure it on trajectories that were held out.

    Examples
    --------
    gpcorrect fit monday.csv tuesday.csv --output model.gpc --report report/

    gpcorrect fit monday.csv --features pose,velocity,memory --output model.gpc

    gpcorrect fit lab.csv --columns map.toml --output model.gpc --json

    gpcorrect fit robot.bag --tracker-log "Take 2026-11-21.csv" --output model.gpc

    gpcorrect fit joints.csv --machine ur5e.urdf --output model.gpc
    """
    from gpcorrect.calibration import FitSettings, HoldOut, learner_named, require_model_place
    from gpcorrect.cleaning import CleaningSettings
    from gpcorrect.rigid import MarkerOption

    require_model_place(output)
    page = opt.report_page(report, output, rejected=True)
    learner_named(method)
    by = HoldOut(opt.one_of(hold_out_by, tuple(HoldOut), "what is held out"))
    settings = FitSettings(
        method=method,
        features=console.split_names(features, "--features"),
        clean=clean,
        cleaning=CleaningSettings(keep=_segments(keep), drop=_segments(drop)),
        marker=opt.one_of(marker, get_args(MarkerOption), "the marker"),
        time_offset=reading.clock_left,
        seed=seed,
    )
    log = reading.log(logs)
    experiment = console.fitted(log, settings, output, page, quiet=json, holdout=holdout, by=by, shuffle=shuffle)
    result = experiment.to_dict()
    if json:
        console.print_json(result)
    else:
        _show(experiment, result, output, page)


def evaluate(
    model: opt.ModelFile,
    logs: opt.Logs,
    reading: Reading,
    report: opt.Report = None,
    mcap: Annotated[
        Path | None,
        typer.Option(help="Folder to write: the measured poses as a ROS 2 recording (MCAP), for Foxglove and RViz."),
    ] = None,
    json: opt.Json = False,
) -> None:
    """Measure a model on recordings it has not seen: errors before, after the rigid part, and corrected.

    For example:

    gpcorrect evaluate model.gpc tuesday.csv wednesday.bag --report tuesday.html

    gpcorrect evaluate model.gpc tuesday.csv --mcap tuesday_poses
    """
    from gpcorrect.calibration import evaluate_model, load

    page = opt.report_page(report, rejected=True)
    if mcap is not None:
        require_new(mcap)
    corrector = load(model)
    log, clocks = corrector.on_one_clock(reading.log(logs), reading.clock_left)
    measured = evaluate_model(corrector, log)
    result = {"n_test": len(measured.clean.rows), "dropped": dict(measured.cleaning.counts), **measured.to_dict()}
    console.write_evaluation_page(measured, log, model, clocks.notes, page)
    if mcap is not None:
        from gpcorrect.report.mcap_file import write_mcap  # the report's libraries are an extra

        write_mcap(measured, log, mcap)
    if json:
        console.print_json(result)
        return
    console.note(*clocks.notes, *measured.cautions)
    console.show_errors(f"{result['n_test']} samples that pass cleaning", result["errors"])
    console.show_errors(f"all {len(measured.dirty.rows)} samples as they came", result["errors_dirty"])
    console.out.print(console.certainty(result))
    if page is not None:
        console.out.print(f"report: {page}")
    if mcap is not None:
        console.out.print(f"poses: {mcap}")


def _segments(texts: list[str] | None) -> tuple[Segment, ...]:
    from gpcorrect.cleaning import Segment

    segments = []
    for text in texts or ():
        try:
            trajectory, start, stop = text.split(":")
            segments.append(Segment(int(trajectory), float(start), float(stop)))
        except ValueError as error:
            hint = "For example: --drop 3:12.5:14.0"
            raise DataError(f"a segment is TRAJECTORY:START:STOP in seconds, got {text!r}.", hint=hint) from error
    return tuple(segments)


def _show(experiment: Experiment, result: dict[str, Any], output: Path, page: Path | None) -> None:
    console.note(*experiment.fit.remarks, *(experiment.evaluation.cautions if experiment.evaluation else ()))
    if result["errors"]:
        console.show_errors(f"Held-out error, {result['n_test']} samples that pass cleaning", result["errors"])
        console.show_errors("All held-out samples as they came", result["errors_dirty"])
        console.out.print(console.certainty(result))
    dropped = console.dropped_words(result["model"]["fit"]["dropped"])
    console.out.print(f"trained on {result['n_train']} samples in {result['seconds']:.1f} s; dropped: {dropped}")
    console.out.print(f"model: {output}" + (f"   report: {page}" if page else ""))


def compare(
    one: opt.AnyModel,
    other: opt.AnyModel,
    logs: opt.Logs,
    reading: Reading,
    report: opt.Report = None,
    json: opt.Json = False,
) -> None:
    """Measure two models of one task on the same samples of recordings: errors, intervals, domain, side by side.

    Example: gpcorrect compare monday.gpc tuesday.gpc wednesday.csv --report compare.html
    """
    from gpcorrect.calibration import load_any, measure_both, model_hash, refuse_unlike

    page = opt.report_page(report)
    first, second = load_any(one), load_any(other)
    if model_hash(one) == model_hash(other):
        raise DataError(f"{one} and {other} are one model, and would not differ.", hint="Give two models.")
    names = (one.stem, other.stem) if one.stem != other.stem else (str(one), str(other))
    refuse_unlike(first, second, names)
    log = reading.joint_log(logs) if first.TASK == "joints" else reading.log(logs)
    log, clocks = first.on_one_clock(log, reading.clock_left)
    both = measure_both(first, second, log)
    figures = both.to_dict(names)
    console.note(*clocks.notes)
    for model in figures["models"]:
        for caution in model["cautions"]:
            console.note(f"{model['name']}: {caution}")
    if page is not None:
        from gpcorrect.report import write_compare_report  # the report's libraries are an extra

        write_compare_report(both, names, clocks.notes, page)
    if json:
        console.print_json(figures)
        return
    _show_both(figures, [f"{p.name} [{p.unit}]" for p in both.parts])
    for difference in both.differences():
        console.out.print(difference.sentence(names))
    if page is not None:
        console.out.print(f"report: {page}")


def _show_both(figures: dict[str, Any], parts: list[str]) -> None:
    title = f"Errors on the {figures['samples']} samples that pass the cleaning of both"
    table = console.plain_table("model", "part", "", "mean", "SD", "rmse", "p95", "max", "", title=title, left=3)
    for model in figures["models"]:
        for row in model["errors"]:
            leaves = [f"{row[leaf]:.3f}" for leaf in ("mean", "sd", "rmse", "p95", "max")]
            table.add_row(model["name"], row["part"], row["method"], *leaves, row["unit"])
    console.out.print(table)
    names = [model["name"] for model in figures["models"]]
    columns = [f"{part} {name}" for part in parts for name in names]
    columns += [f"in domain {name}" for name in names]
    table = console.plain_table("trajectory", "samples", *columns, title="Mean errors")
    for row in figures["trajectories"]:
        means = [f"{mean:.3f}" for pair in row["mean"].values() for mean in pair]
        inside = [f"{100 * near:.1f} %" for near in row["in_domain"]]
        table.add_row(str(row["trajectory"]), str(row["samples"]), *means, *inside)
    console.out.print(table)
    for model in figures["models"]:
        covered, near = 100 * model["coverage95"], 100 * model["in_domain"]
        console.out.print(f"{model['name']}: 95 % intervals cover {covered:.1f} %; {near:.1f} % in domain")
