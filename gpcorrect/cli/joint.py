"""`gpcorrect joint`: calibrate joints from logs with outside encoders; measure, compare, set zeros anew."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from gpcorrect.cli import console
from gpcorrect.cli import options as opt
from gpcorrect.cli.reading import Reading
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect.calibration import Evaluation, FitSettings, JointErrors

joint_app = typer.Typer(no_args_is_help=True)

Method = Annotated[str, typer.Option(help="One of offset, linear, quadratic, network, ukf, gp, trees, auto.")]
Features = Annotated[
    str | None,
    typer.Option(help="position, velocity, acceleration, effort, memory, lags, state; the method's own when absent."),
]
Input = Annotated[
    str | None,
    typer.Option(
        "--input",
        help="measured_jp or setpoint_jp: what is reported where logged, with --direction command what was sent.",
    ),
]
Way = Annotated[str, typer.Option("--direction", help="estimate (reported to true) or command (desired to commanded).")]
Model = Annotated[Path, typer.Argument(help="Model file that `gpcorrect joint fit` wrote.")]


@joint_app.command()
def fit(
    logs: opt.Logs,
    output: opt.ModelOutput,
    reading: Reading,
    method: Method = "gp",
    features: Features = None,
    input_signal: Input = None,
    direction: Way = "estimate",
    holdout: opt.Holdout = 0.2,
    hold_out_by: opt.HoldOutBy = "auto",
    clean: opt.Clean = True,
    end_to_end: Annotated[bool, typer.Option("--end-to-end", help="Learn the true positions, not the error.")] = False,
    layers: Annotated[str | None, typer.Option(help="Widths of the network: 100,100 when absent.")] = None,
    seed: opt.Seed = 0,
    report: opt.Report = None,
    json: opt.Json = False,
) -> None:
    """Learn joint errors from recordings with outside encoders, and measure on trajectories that were held out.

    With --machine a tracker of whole poses stands in for the encoders.

    For example:

    gpcorrect joint fit zigzags.csv --method gp --output joints.gpc --report joints.html

    gpcorrect joint fit monday.csv --method network --features position,effort --output net.gpc --json

    gpcorrect joint fit ur5e.bag --machine ur5e.xml --output joints.gpc
    """
    from gpcorrect.calibration import HoldOut, JointCorrector, learner_named, require_model_place

    require_model_place(output)
    page = opt.report_page(report, output, rejected=True)
    learner_named(method)
    by = HoldOut(opt.one_of(hold_out_by, tuple(HoldOut), "what is held out"))
    settings = replace(
        _settings(features, input_signal, direction, reading.clock_left, seed),
        method=method,
        clean=clean,
        end_to_end=end_to_end,
    )
    if layers is not None:
        widths = console.split_names(layers, "--layers")
        if not widths or not all(width.isdigit() and int(width) > 0 for width in widths):
            raise DataError(f"layers are widths above 0, got {layers!r}.", hint="For example 100,100 or 600,500,400")
        if method not in ("network", "auto"):
            raise DataError(
                f"--layers are widths of the network, and the method is {method}.",
                hint="Leave them out, or take --method network.",
            )
        settings = replace(settings, layers=tuple(map(int, widths)))
    log = reading.joint_log(logs)
    experiment = console.fitted(log, settings, output, page, quiet=json, task=JointCorrector, holdout=holdout, by=by)
    result = experiment.to_dict()
    console.note(*experiment.fit.remarks)
    if json:
        console.print_json(result)
        return
    console.note(*result.get("cautions", ()))
    show_joint_errors(
        f"Held-out errors, {experiment.n_test} samples that pass cleaning", result["errors"], experiment.evaluation
    )
    dropped = console.dropped_words(result["model"]["fit"]["dropped"])
    console.out.print(
        f"trained on {result['n_train']} samples in {experiment.seconds:.1f} s; dropped: {dropped} -> {output}"
    )


@joint_app.command()
def evaluate(model: Model, logs: opt.Logs, reading: Reading, report: opt.Report = None, json: opt.Json = False) -> None:
    """Measure a joint model on recordings it has not seen.

    Example: gpcorrect joint evaluate joints.gpc tuesday.csv
    """
    from gpcorrect.calibration import JointCorrector, evaluate_model, load

    page = opt.report_page(report, rejected=True)
    corrector = load(model, JointCorrector)
    log, clocks = corrector.on_one_clock(reading.joint_log(logs), reading.clock_left)
    evaluation = evaluate_model(corrector, log)
    result = {
        "n_test": len(evaluation.clean.rows),
        "dropped": dict(evaluation.cleaning.counts),
        **evaluation.to_dict(),
        "zeros": corrector.zeros(log, evaluation.clean),
    }
    console.write_evaluation_page(evaluation, log, model, clocks.notes, page)
    console.note(*clocks.notes, *evaluation.cautions)
    if json:
        console.print_json(result)
    else:
        show_joint_errors(f"Errors on {result['n_test']} samples", result["errors"], evaluation)
    for row in result["zeros"]:
        if row["moved"]:
            console.note(
                f"session {row['session']}: the zero of joint {row['joint']} is off by "
                f"{row['shift']:+.3f} {row['unit']}, as after a homing; set it anew: gpcorrect joint rezero"
            )


@joint_app.command()
def compare(
    logs: opt.Logs,
    reading: Reading,
    features: Features = None,
    input_signal: Input = None,
    direction: Way = "estimate",
    holdout: opt.Holdout = 0.2,
    seed: opt.Seed = 0,
    json: opt.Json = False,
) -> None:
    """Fit every method on the same trajectories and print their held-out RMSE, a row a method.

    Example: gpcorrect joint compare zigzags.csv
    """
    from gpcorrect.calibration import LEARNERS, JointCorrector, run_experiment

    log = reading.joint_log(logs)
    rows: list[dict[str, Any]] = []
    settings = _settings(features, input_signal, direction, reading.clock_left, seed)
    with console.progress_bar(quiet=json) as progress:
        for number, method in enumerate(LEARNERS):
            progress.step("methods", number / len(LEARNERS))
            chosen = replace(settings, method=method)
            experiment = run_experiment(log, chosen, task=JointCorrector, holdout=holdout)
            errors = experiment.to_dict()["errors"]
            if not errors:
                raise DataError("comparing needs held-out trajectories.", hint="Give --holdout above 0.")
            if not rows:
                rows.append({"method": "raw", "seconds": 0.0, "errors": errors["raw"]})
            rows.append({"method": method, "seconds": experiment.seconds, "errors": errors["corrected"]})
    if json:
        console.print_json({"n_train": experiment.fit.n_train, "n_test": experiment.n_test, "methods": rows})
        return
    joints = [f"J{leaf['joint']} [{leaf['unit']}]" for leaf in rows[0]["errors"]]
    table = console.plain_table("method", *joints, "seconds", title=f"Held-out RMSE, {experiment.n_test} samples")
    best = [min(row["errors"][j]["rmse"] for row in rows) for j in range(len(joints))]
    for row in rows:
        found = zip([leaf["rmse"] for leaf in row["errors"]], best, strict=True)
        cells = [console.styled((f"{rmse:.4f}", "bold" if rmse == least else "")) for rmse, least in found]
        table.add_row(row["method"], *cells, f"{row['seconds']:.1f}")
    console.out.print(table)


@joint_app.command()
def rezero(model: Model, logs: opt.Logs, output: opt.ModelOutput, reading: Reading, json: opt.Json = False) -> None:
    """Set the zeros of a model anew from a short run, as after a homing: a minute instead of a calibration.

    Example: gpcorrect joint rezero joints.gpc minute.csv --output joints-today.gpc
    """
    import numpy as np

    from gpcorrect.calibration import JointCorrector, joint_units, load, require_model_place, save

    require_model_place(output)
    corrector = load(model, JointCorrector)
    log, clocks = corrector.on_one_clock(reading.joint_log(logs), reading.clock_left)
    console.note(*clocks.notes)
    fresh = corrector.rezeroed(log)
    names, scale = joint_units(corrector.types)
    shift = (fresh.zero - corrector.zero) * scale
    moved = [row["moved"] for row in corrector.zeros(log, corrector.measure(log, np.ones(len(log), dtype=bool)))]
    save(fresh, output)
    rows = [{"joint": j + 1, "unit": names[j], "shift": float(shift[j]), "moved": moved[j]} for j in range(len(names))]
    if json:
        console.print_json({"zeros": rows})
        return
    for row in rows:
        found = "moved" if row["moved"] else "within the model's own uncertainty"
        console.out.print(f"joint {row['joint']}: zero {row['shift']:+.4f} {row['unit']}, {found}")
    console.out.print(f"model: {output}")


def _settings(
    features: str | None, input_signal: str | None, direction: str, time_offset: str, seed: int
) -> FitSettings:
    from gpcorrect.calibration import FitSettings, InputSignal
    from gpcorrect.calibration.settings import Direction

    return FitSettings(
        features=console.split_names(features, "--features"),
        input_signal=opt.one_of(input_signal, (None, *get_args(InputSignal)), "the input"),
        direction=opt.one_of(direction, get_args(Direction), "the direction"),
        time_offset=time_offset,
        seed=seed,
    )


def show_joint_errors(title: str, errors: dict[str, JointErrors], evaluation: Evaluation | None = None) -> None:
    """Print a table of joint errors, before and after.

    Parameters
    ----------
    title : str
    errors : dict, of each method, a row a joint; empty where nothing was held out
    evaluation : Evaluation, optional, which shares of the corrected errors the 95 % intervals hold
    """
    if not errors:
        console.note("nothing was held out, so nothing was measured")
        return
    covered = ("95 % hold",) if evaluation else ()
    table = console.plain_table("joint", "unit", "", "rmse", "mean", "SD", "p95", "max", *covered, title=title, left=0)
    for name, rows in errors.items():
        for j, row in enumerate(rows):
            leaves = [f"{row[k]:.4f}" for k in ("rmse", "mean", "sd", "p95", "max")]
            if evaluation and name == "corrected" and not math.isnan(share := evaluation.clean.coverage95[j]):
                leaves.append(f"{100 * share:.0f} %")
            table.add_row(str(row["joint"]), str(row["unit"]), name, *leaves)
    console.out.print(table)
