"""`gpcorrect zigzag` and `collect`: calibration trajectories, and a joint calibration from driving to measuring."""

from __future__ import annotations

import gc
import math
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gpcorrect.atomic import make_folder, require_new
from gpcorrect.cli import options as opt
from gpcorrect.cli.console import err, note, out, print_json, print_result, progress_bar, split_names
from gpcorrect.cli.processes import end_as_interrupted, free_endpoint, running
from gpcorrect.cli.reading import chain_of
from gpcorrect.errors import DataError, LogError

if TYPE_CHECKING:
    from gpcorrect.calibration import TimedPath
    from gpcorrect.types import CalibrationLog, FloatArray, Progress
    from gpcorrect_service.crtk.robot import Robot

collect_app = typer.Typer(no_args_is_help=True)

Sparsity = Annotated[int, typer.Option(help="n: stripes lie 1/n of the block's side apart.", min=1, max=100)]

UNITS = (math.radians(1.0), math.radians(1.0), 1e-3)  # rad, rad, m
ROUNDING = 1e-9  # rad and m: of limits written in degrees and millimetres
RATE_HZ = 30.0  # of driven paths, as in Peng et al. 2024
PATIENCE = 120.0  # s for the simulated arm to come up


def zigzag_command(
    output: Annotated[Path, typer.Option("--output", "-o", help="Trajectory to write, native log format.")],
    direction: Annotated[
        str, typer.Option(help="Joints along which it runs: J1, J2, J3, J1-J2, J2-J3, J1-J3 or J1-J2-J3.")
    ] = "J1",
    sparsity: Sparsity = 4,
    limits: opt.Limits = opt.BLOCK,
    machine: Annotated[
        str, typer.Option(help="Whose limits must hold: packaged machine, robot or model file; or none.")
    ] = "raven2_left",
    speed: opt.Speed = opt.FASTEST,
    rate: Annotated[float, typer.Option(help="Samples a second.", min=0.1, max=1000.0)] = RATE_HZ,
    as_published: Annotated[
        bool, typer.Option("--as-published", help="J1-J2-J3 as the study's published files drive it, not its Eq. (3).")
    ] = False,
    old_arm: opt.OldArm = None,
    json: opt.Json = False,
) -> None:
    """Write a zig-zag calibration trajectory for the first three joints, within their speed limits.

    Every direction sweeps a block of the same centre and volume, so their models can be compared.

    For example:

    gpcorrect zigzag --direction J2-J3 --sparsity 4 --limits 20:60,55:110,330:420 --output traj.csv
    """
    import numpy as np

    from gpcorrect.calibration import direction_named, timed, zigzag
    from gpcorrect.logs import require_writable, write_log
    from gpcorrect.types import CalibrationLog, LogMeta

    require_writable(output)
    require_new(output)
    chosen, block = direction_named(direction), joint_limits(limits)
    if machine != "none":
        _require_within(block, machine)
    corners = zigzag(chosen, sparsity, block, as_published=as_published)
    path = timed(corners, speed_limits(speed), rate)
    still = np.zeros(len(path.time), dtype=np.int64)
    log = CalibrationLog(path.time, still, still, setpoint_jp=path.q, meta=LogMeta(joint_types="RRP"))
    write_log(log, output)
    title = f"zig-zag {chosen}, sparsity 1/{sparsity}: {path.duration / 60:.1f} min"
    facts = {
        "direction": chosen,
        "sparsity": sparsity,
        "corners": len(corners),
        "samples": len(path.time),
        "seconds": path.duration,
        "output": str(output),
    }
    words = f"{title}, {len(corners)} corners, {len(path.time)} samples -> {output}"
    print_result(facts, words, as_json=json)


@collect_app.command(name="zigzag")
def collect_zigzag(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for logs and model.")],
    direction: Annotated[str, typer.Option(help="Zig-zags to drive, with commas: J1, J2, J3, J1-J2, ...")] = "J1,J2,J3",
    sparsity: Sparsity = 3,
    limits: opt.Limits = opt.BLOCK,
    speed: opt.Speed = opt.FASTEST,
    test: Annotated[float, typer.Option(help="Seconds of random motion to measure on.", min=5)] = 120.0,
    method: Annotated[str, typer.Option(help="How to calibrate; see gpcorrect joint fit.")] = "gp",
    endpoint: Annotated[
        str | None, typer.Option(help="Address of a robot that runs; a simulated one is started without it.")
    ] = None,
    arm: opt.ArmName = "arm1",
    namespace: opt.KeyRoot = "gpcorrect",
    time_scale: Annotated[float, typer.Option(help="How many times faster the simulated arm lives.")] = 20.0,
    seed: Annotated[int, typer.Option(help="Seed of test motion, noise and fit.", min=0)] = 0,
    old_connect: opt.OldConnect = None,
    json: opt.Json = False,
) -> None:
    """Drive zig-zags and a random test run, record them, learn the joints' errors, and measure on the test run.

    The outside encoders must be published as external_js, as the simulated arm does.

    For example:

    gpcorrect collect zigzag --output calibration/

    gpcorrect collect zigzag --direction J2-J3 --sparsity 4 --endpoint tcp/127.0.0.1:7448 --output today/
    """
    from gpcorrect import calibration
    from gpcorrect.cli.joint import show_joint_errors
    from gpcorrect_service.crtk import BusSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.crtk.recorder import require_no_journal
    from gpcorrect_service.crtk.robot import Robot

    make_folder(output)
    for name in ("zigzags.csv", "test.csv"):
        require_no_journal(output / name)
    block, fastest = joint_limits(limits), speed_limits(speed)
    corners = [
        calibration.zigzag(calibration.direction_named(name), sparsity, block)
        for name in split_names(direction, "--direction")
    ]
    calibration.learner_named(method)
    settings = calibration.FitSettings(method=method, time_offset="none", seed=seed)
    with ExitStack() as stack:
        place = endpoint or free_endpoint()
        if endpoint is None:
            words = ["--machine", "raven2_calibration", "--arm", arm, "--namespace", namespace, "--endpoint", place]
            more = ["--rate", f"{RATE_HZ:g}", "--time-scale", f"{time_scale:g}", "--seed", str(seed)]
            stack.enter_context(running("sim", "serve", *words, *more))
        at = BusSettings(place, arm, namespace)
        robot = stack.enter_context(Robot(at if endpoint else replace(at, patience=PATIENCE)))
        robot.make_ready()
        end_as_interrupted()
        gc.freeze()  # what was imported: a collection that goes through it would stop the commands for 0.15 s
        progress = stack.enter_context(progress_bar(quiet=json))
        ways = [calibration.timed(way, fastest, RATE_HZ) for way in corners]
        train = _recorded(robot, ways, progress, "zig-zags", output / "zigzags.csv")
        tested = _recorded(robot, [_sines(block, fastest, test, seed)], progress, "test run", output / "test.csv")
    fitted = calibration.fit_model(train, settings, task=calibration.JointCorrector)
    calibration.save(fitted.corrector, output / "joints.gpc")
    evaluation = calibration.evaluate_model(fitted.corrector, tested)
    measured = {"n_test": len(evaluation.clean.rows), **evaluation.to_dict()}
    if json:
        print_json({"n_train": len(train), **measured, "output": str(output)})
        return
    show_joint_errors(f"Errors on {measured['n_test']} samples of the random test run", measured["errors"])
    out.print(f"trained on {len(train)} samples of {len(train.trajectory_ids)} zig-zags -> {output / 'joints.gpc'}")
    err.print(f"recordings: {output / 'zigzags.csv'}, {output / 'test.csv'}")


def _sines(block: FloatArray, fastest: FloatArray, seconds: float, seed: int) -> TimedPath:
    """Return random motion inside the part of the block that every zig-zag sweeps."""
    import numpy as np

    from gpcorrect.calibration import random_sinusoids

    middle, reach = block.mean(axis=1)[:, None], np.ptp(block, axis=1)[:, None]
    inside = middle + reach * np.array([-0.25, 0.25])
    return random_sinusoids(inside, fastest, seconds, RATE_HZ, np.random.default_rng([seed, 1]))


def _recorded(robot: Robot, paths: list[TimedPath], progress: Progress, what: str, target: Path) -> CalibrationLog:
    """Drive paths, a trajectory each, and return what was recorded of them; it is written however that ended."""
    from gpcorrect.logs import write_log
    from gpcorrect.types import LogMeta
    from gpcorrect_service.crtk.recorder import Journal, Recorder

    types = "RRP" if len(robot.setpoint) == len(UNITS) else ""
    meta = LogMeta(arm=robot.bus.settings.arm, joint_types=types)
    with Journal(target, meta.arm) as journal:
        recorder = Recorder(robot.bus, ("measured_js", "setpoint_js", "external_js"), journal)
        try:
            for number, path in enumerate(paths):
                progress.step(what, number / len(paths))
                robot.follow(path.time, path.q, number)
        except BaseException:  # the robot's refusal, or Ctrl-C
            with suppress(LogError):  # nothing was driven yet
                write_log(recorder.recording().log(meta), target)
                note(f"what was recorded until then: {target}")
            journal.remove()
            raise
        progress.step(what, 1.0)
        log = recorder.recording().log(meta)
        write_log(log, target)
        journal.remove()
        return log


def _require_within(block: FloatArray, name: str) -> None:
    """Refuse a block that the arm's own limits do not hold."""
    allowed = chain_of(name).limits[: len(block)]
    if len(allowed) < len(block):
        raise DataError(f"{name} has {len(allowed)} moving joints; zig-zags move {len(block)}.")
    for joint, ((low, high), (least, most), unit) in enumerate(zip(block, allowed, UNITS, strict=True), start=1):
        if low < least - ROUNDING or high > most + ROUNDING:
            raise DataError(
                f"joint {joint} would go from {low / unit:g} to {high / unit:g}, beyond the limits of {name}, "
                f"{least / unit:g} to {most / unit:g}.",
                hint="Narrow --limits, name another --machine, or give --machine none.",
            )


def joint_limits(text: str) -> FloatArray:
    """Return (3, 2) limits, rad and m, of a text of three pairs LOW:HIGH in deg, deg and mm; DataError for another.

    Parameters
    ----------
    text : str, such as 20:60,55:110,330:420
    """
    import numpy as np

    pairs = text.split(",")
    if len(pairs) != len(UNITS):
        raise DataError(f"limits are three pairs LOW:HIGH, got {text!r}.", hint="For example 20:60,55:110,330:420")
    limits: FloatArray = np.array(UNITS)[:, None] * np.array([opt.numbers(pair, ":", 2, "limits") for pair in pairs])
    return limits


def speed_limits(text: str) -> FloatArray:
    """Return (3,) speed limits, rad/s and m/s, of a text of three numbers in deg/s, deg/s and mm/s.

    Parameters
    ----------
    text : str, such as 5,5,20
    """
    import numpy as np

    return np.asarray(np.array(UNITS) * opt.numbers(text, ",", len(UNITS), "speed limits"))
