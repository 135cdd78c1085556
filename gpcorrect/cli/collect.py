"""`gpcorrect collect`: a joint calibration from end to end: drive, record, fit, measure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from gpcorrect.atomic import make_folder
from gpcorrect.cli.console import err, out, print_json, progress_bar, split_names
from gpcorrect.cli.joint import show_joint_errors
from gpcorrect.cli.options import Json
from gpcorrect.cli.processes import free_endpoint, running
from gpcorrect.cli.zigzag import UNIT, joint_limits, numbers
from gpcorrect.joint import TimedPath, direction_named, random_sinusoids, timed, zigzag
from gpcorrect.joint_artifact import save_joint
from gpcorrect.joint_corrector import JointSettings, evaluate_joint, fit_joint, method_named
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, Progress

if TYPE_CHECKING:
    from gpcorrect_service.crtk.robot import Robot

__all__ = ["collect_app"]

collect_app = typer.Typer(no_args_is_help=True, help="Calibrations from end to end: drive, record, fit, measure.")

RATE_HZ = 30.0  # of driven paths
PATIENCE = 120.0  # s for the simulated arm to come up
MACHINE = "raven2_calibration"


@dataclass(frozen=True)
class _Drive:
    """What is driven: ranges, speeds, seconds of the test, seed."""

    limits: FloatArray
    speed: FloatArray
    test_seconds: float
    seed: int


@collect_app.callback()
def collect() -> None:
    """Calibrations from end to end."""


@collect_app.command(name="zigzag")
def collect_zigzag(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for logs and model.", show_default=False)],
    direction: Annotated[str, typer.Option(help="Zig-zags to drive, with commas: J1, J2, J3, J1-J2, ...")] = "J1,J2,J3",
    sparsity: Annotated[int, typer.Option(help="n: stripes lie 1/n of the block's side apart.", min=1)] = 3,
    limits: Annotated[str, typer.Option(help="LOW:HIGH of joints 1, 2 (deg) and 3 (mm).")] = "20:60,55:110,330:420",
    speed: Annotated[str, typer.Option(help="Speed limits of joints 1, 2 (deg/s) and 3 (mm/s).")] = "5,5,20",
    test: Annotated[float, typer.Option(help="Seconds of random motion to measure on.", min=5)] = 120.0,
    method: Annotated[str, typer.Option(help="How to calibrate; see gpcorrect joint fit.")] = "gp",
    connect: Annotated[
        str | None, typer.Option(help="Address of a robot that runs; a simulated one is started without it.")
    ] = None,
    arm: Annotated[str, typer.Option(help="CRTK name of the arm.")] = "arm1",
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    time_scale: Annotated[float, typer.Option(help="How many times faster the simulated arm lives.")] = 20.0,
    seed: Annotated[int, typer.Option(help="Seed of test motion, noise and fit.", min=0)] = 0,
    json: Json = False,
) -> None:
    """Drive zig-zags and a random test run, record them, learn the joints' errors, and measure on the test run.

    The outside encoders must be published as external_js, as the simulated arm does.

    For example:

    gpcorrect collect zigzag --output calibration/

    gpcorrect collect zigzag --direction J2-J3 --sparsity 4 --connect tcp/127.0.0.1:7448 --output today/
    """
    from gpcorrect_service.crtk import BusSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.crtk.robot import Robot

    make_folder(output)
    drive = _Drive(joint_limits(limits), UNIT * np.array(numbers(speed, ",", 3, "speed limits")), test, seed)
    paths = [_zigzag(name, sparsity, drive) for name in split_names(direction)]
    chosen = method_named(method)
    with ExitStack() as stack:
        endpoint = connect or stack.enter_context(_simulated(arm, namespace, time_scale, seed))
        robot = stack.enter_context(Robot(BusSettings(endpoint, arm, namespace, patience=PATIENCE), PATIENCE))
        robot.make_ready()
        progress = stack.enter_context(progress_bar(quiet=json))
        train = _recorded(robot, paths, progress, "zig-zags")
        tested = _recorded(robot, [_sines(drive)], progress, "test run")
    write_log(train, output / "zigzags.csv")
    write_log(tested, output / "test.csv")
    fitted = fit_joint(train, JointSettings(method=chosen, holdout=0.0, time_offset="none", seed=seed))
    save_joint(fitted.corrector, output / "joints.gpc")
    measured = evaluate_joint(fitted.corrector, tested, "none")
    _told(train, measured, output, json=json)


@contextmanager
def _simulated(arm: str, namespace: str, time_scale: float, seed: int) -> Iterator[str]:
    """Run an arm in another process and give its address."""
    endpoint = free_endpoint()
    words = ["--machine", MACHINE, "--arm", arm, "--namespace", namespace, "--endpoint", endpoint]
    more = ["--rate", f"{RATE_HZ:g}", "--time-scale", f"{time_scale:g}", "--seed", str(seed)]
    with running("sim", "serve", *words, *more):
        yield endpoint


def _zigzag(name: str, sparsity: int, drive: _Drive) -> TimedPath:
    return timed(zigzag(direction_named(name), sparsity, drive.limits), drive.speed, RATE_HZ)


def _sines(drive: _Drive) -> TimedPath:
    middle, reach = drive.limits.mean(axis=1)[:, None], np.ptp(drive.limits, axis=1)[:, None]
    inside = middle + reach * np.array([-0.25, 0.25])  # the block that every zig-zag sweeps
    rng = np.random.default_rng([drive.seed, 1])
    return random_sinusoids(inside, drive.speed, drive.test_seconds, RATE_HZ, rng)


def _recorded(robot: Robot, paths: list[TimedPath], progress: Progress, what: str) -> CalibrationLog:
    """Drive paths, a trajectory each, and return what was recorded of them."""
    from gpcorrect_service.crtk.recorder import Recorder

    recorder = Recorder(robot.bus, ("measured_js", "setpoint_js", "external_js"))
    for number, path in enumerate(paths):
        progress.step(what, number / len(paths))
        here = robot.setpoint
        whole = np.repeat(here[None], len(path.q), axis=0)
        whole[:, : path.q.shape[1]] = path.q
        robot.follow(path.time, whole, number)
    progress.step(what, 1.0)
    types = "RRP" if len(robot.setpoint) == len(UNIT) else ""
    return recorder.recording().log(LogMeta(arm=robot.bus.settings.arm, joint_types=types))


def _told(train: CalibrationLog, measured: dict[str, Any], output: Path, *, json: bool) -> None:
    if json:
        print_json({"n_train": len(train), **measured, "output": str(output)})
        return
    show_joint_errors(f"Errors on {measured['n_test']} samples of the random test run", measured["errors"])
    out.print(f"trained on {len(train)} samples of {len(train.trajectory_ids)} zig-zags -> {output / 'joints.gpc'}")
    err.print(f"recordings: {output / 'zigzags.csv'}, {output / 'test.csv'}")
