"""`gpcorrect simulate`: a recording of a simulated cable-driven arm, in the native format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gpcorrect.atomic import require_folder
from gpcorrect.cli.console import out
from gpcorrect.errors import DataError
from gpcorrect.logs import write_log
from gpcorrect.sim import Model, debridement_log, joint_motion_log, random_reaches_log, read_model
from gpcorrect.types import CalibrationLog

__all__ = ["simulate"]

TASKS = ("debridement", "reaches", "joints")
DEFAULT_COUNTS = {"debridement": 303, "reaches": 40, "joints": 24}


def simulate(
    task: Annotated[
        str | None,
        typer.Argument(help="debridement (default), reaches, or joints (default with --model).", show_default=False),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Log to write: CSV or Parquet by its ending.", show_default=False)
    ] = Path("log.csv"),
    model: Annotated[
        Path | None, typer.Option(help="Machine to simulate (TOML); a packaged one without it.", show_default=False)
    ] = None,
    arm: Annotated[str, typer.Option(help="Arm of the packaged machine, for reaches.")] = "raven2_left",
    reaches: Annotated[
        int | None, typer.Option("--reaches", "--trajectories", help="How many motions.", show_default=False)
    ] = None,
    seconds: Annotated[float, typer.Option(help="Length of each motion, for joints.")] = 20.0,
    sessions: Annotated[int, typer.Option(help="Sessions, with a homing before each, for reaches and joints.")] = 1,
    payload: Annotated[
        list[float] | None, typer.Option(help="Payload in kg, in turn for reaches and joints. Repeatable.")
    ] = None,
    clean: Annotated[bool, typer.Option("--clean", help="A tracker without occlusions and outliers.")] = False,
    position_only: Annotated[bool, typer.Option("--position-only", help="A tracker that sees positions only.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of motion, noise and faults.", min=0)] = 0,
) -> None:
    """Simulate a recording: what was commanded, reported, and seen by an outside tracker, faults included.

    For example:

    gpcorrect simulate debridement --output reaches.csv

    gpcorrect simulate reaches --arm dvrk_psm --reaches 60 --output psm.parquet

    gpcorrect simulate joints --model model.toml --seed 3 --output joints.csv
    """
    require_folder(output)
    machine = None if model is None else read_model(model)
    chosen = task or ("debridement" if machine is None else "joints")
    if chosen not in TASKS:
        raise DataError(f"a task is one of {', '.join(TASKS)}; got {chosen!r}.")
    count = DEFAULT_COUNTS[chosen] if reaches is None else reaches
    if chosen == "debridement":
        log = debridement_log(seed, reaches=count, faults=not clean, position_only=position_only, model=machine)
    elif chosen == "reaches":
        log = random_reaches_log(
            arm,
            count,
            seed,
            sessions=sessions,
            payloads=payload or (),
            position_only=position_only,
            faults=not clean,
            model=machine,
        )
    else:
        log = joint_motion_log(_needed(machine), count, seconds, seed, sessions=sessions, payloads=payload or ())
    write_log(log, output)
    out.print(_told(log, output))


def _needed(machine: Model | None) -> Model:
    if machine is None:
        raise DataError("joint motion needs to know the machine.", hint="Give it: --model model.toml")
    return machine


def _told(log: CalibrationLog, output: Path) -> str:
    return f"{len(log)} samples, {len(log.trajectory_ids)} trajectories: {', '.join(log.signals)} -> {output}"
