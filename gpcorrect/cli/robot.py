"""`gpcorrect robot`: tools of a robot's controller over CRTK: go to joints, random motion, follow, record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from threading import TIMEOUT_MAX
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from gpcorrect.atomic import require_new
from gpcorrect.cli import options as opt
from gpcorrect.cli.collect import RATE_HZ, joint_limits, speed_limits
from gpcorrect.cli.console import err, note, out, print_json, print_result, split_names
from gpcorrect.cli.processes import stop_signal
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect.types import FloatArray
    from gpcorrect_service.crtk.recorder import Recording
    from gpcorrect_service.crtk.robot import Robot

robot_app = typer.Typer(no_args_is_help=True)

Mcap = Annotated[Path | None, typer.Option(help="ROS 2 recording to write as well: a folder with an MCAP file.")]
Sliding = Annotated[str, typer.Option(help="Numbers of the sliding joints.")]
DEGREE = np.deg2rad(1.0)


@robot_app.command()
def state(place: opt.RobotPlace, json: opt.AlwaysJson = True) -> None:
    """Print the robot's operating state, joints and tool pose (JSON).

    Example: gpcorrect robot state --arm PSM1
    """
    with _robot(place) as robot:
        now = robot.state
        facts = {"state": now.state, "is_homed": now.is_homed, "is_busy": now.is_busy, "stamp": robot.time}
        joints = {"setpoint_jp": robot.setpoint, "measured_jp": robot.measured}
        print_json({**facts, **joints, "setpoint_cp": robot.setpoint_pose})


@robot_app.command()
def operate(
    command: Annotated[
        str, typer.Argument(help="enable, disable, pause, resume, home, unhome; ready: enable and home.")
    ],
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Change the robot's operating state.

    Example: gpcorrect robot operate ready
    """
    with _robot(place) as robot:
        if command == "ready":
            robot.make_ready()
        else:
            robot.operate(command)
        now = robot.state
    words = f"{now.state}, {'homed' if now.is_homed else 'not homed'}"
    print_result({"state": now.state, "is_homed": now.is_homed}, words, as_json=json)


@robot_app.command()
def goto(
    joints: Annotated[str, typer.Argument(help="Joint positions: degrees, and mm for sliding joints, with commas.")],
    sliding: Sliding = "3",
    *,
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Go to a joint position, within the speed limits, and wait until the robot is there.

    Example: gpcorrect robot goto 40,90,380,0,0,0
    """
    with _robot(place) as robot:
        dof = len(robot.setpoint)
        scale = np.full(dof, DEGREE)  # rad in a degree, and m in a millimetre for sliding joints
        for text in filter(None, sliding.split(",")):
            if not (text.strip().isdigit() and 1 <= int(text) <= dof):
                raise DataError(f"sliding joints are numbers from 1 to {dof}, got {sliding!r}.")
            scale[int(text) - 1] = 1e-3
        robot.move_jp(scale * np.array(opt.numbers(joints, ",", len(scale), "joints")))
        there = robot.measured
    words = f"there: {np.round(there / scale, 3).tolist()} (deg, mm)"
    print_result({"measured_jp": there}, words, as_json=json)


@robot_app.command()
def random(
    limits: opt.Limits = opt.BLOCK,
    speed: opt.Speed = opt.FASTEST,
    seconds: Annotated[float, typer.Option(help="How long.", min=1)] = 60.0,
    seed: Annotated[int, typer.Option(help="Seed of the motion.", min=0)] = 0,
    *,
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Move the first three joints in random sinusoids; the others stay.

    Example: gpcorrect robot random --seconds 120 --seed 3
    """
    from gpcorrect.calibration import random_sinusoids

    path = random_sinusoids(joint_limits(limits), speed_limits(speed), seconds, RATE_HZ, np.random.default_rng(seed))
    with _robot(place) as robot:
        robot.follow(path.time, path.q)
    print_result({"seconds": path.duration}, f"moved for {path.duration:.0f} s", as_json=json)


@robot_app.command()
def follow(
    trajectory: Annotated[Path, typer.Argument(help="Joint paths to drive, as `gpcorrect zigzag` writes them.")],
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Drive recorded or planned joint paths, a trajectory after the other, and tell recorders which is which.

    Example: gpcorrect robot follow zigzag.csv
    """
    from gpcorrect.logs import read_log

    log = read_log(trajectory)
    if log.setpoint_jp is None:
        raise DataError("the trajectory has no setpoint_jp.", hint="Make one: gpcorrect zigzag --output traj.csv")
    driven: list[dict[str, Any]] = []
    with _robot(place) as robot:
        for number, rows in log.trajectories():
            robot.follow(log.time[rows], log.setpoint_jp[rows], number)
            driven.append({"trajectory": int(number), "seconds": float(np.ptp(log.time[rows]))})
            if not json:
                out.print(f"trajectory {number}: {driven[-1]['seconds']:.0f} s")
    if json:
        print_json({"trajectories": driven})


@robot_app.command()
def draw(
    model: Annotated[Path | None, typer.Option(help="Draw in the middle of what this model knows.")] = None,
    centre: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        typer.Option(help="Centre and orientation: x y z (m) qw qx qy qz."),
    ] = None,
    radius: Annotated[float, typer.Option(help="mm.", min=0.1)] = 10.0,
    speed: Annotated[float, typer.Option(help="cm/s.", min=0.1)] = 1.0,
    rounds: Annotated[float, typer.Option(help="How many circles.", min=0.1)] = 3.0,
    frame: Annotated[str, typer.Option(help="Name of the frame that the poses are in.")] = "tracker",
    *,
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Send desired poses on servo_cp, as a planner does: go to a circle and draw it.

    Example: gpcorrect robot draw --model model.gpc --rounds 10, with gpcorrect prefilter running
    """
    from gpcorrect.planning import circle
    from gpcorrect_service.crtk import Pose

    path = circle(_centre(model, centre), radius / 1e3, speed / 100, rounds)
    with _robot(place) as robot:
        robot.bus.publish("move_cp", Pose(robot.time, tuple(path.poses[0].tolist()), frame))
        robot.rest()
        robot.follow_poses(path.times, path.poses, frame)
    words = f"{rounds:g} circles of {radius:g} mm in {path.duration:.0f} s"
    print_result({"rounds": rounds, "radius_mm": radius, "seconds": path.duration}, words, as_json=json)


@robot_app.command()
def record(
    output: opt.LogOutput,
    mcap: Mcap = None,
    seconds: Annotated[float | None, typer.Option(help="How long; until Ctrl-C without it.")] = None,
    *,
    place: opt.RobotPlace,
    json: opt.Json = False,
) -> None:
    """Record what the robot publishes: joints, poses, tracker, outside encoders; a recording is never overwritten.

    Example: gpcorrect robot record --seconds 60 --output run.parquet --mcap run_bag
    """
    if seconds is not None and not 0.0 < seconds < TIMEOUT_MAX:
        raise DataError(
            f"a recording has a length in seconds above 0, got {seconds:g}.", hint="Until Ctrl-C: leave it out."
        )
    stop = stop_signal()
    from gpcorrect.logs import require_writable
    from gpcorrect_service.crtk.recorder import Journal, Recorder, require_mcap, require_no_journal

    require_writable(output)
    require_no_journal(output)
    if mcap is not None:
        require_mcap(mcap)
    with _robot(place) as robot, Journal(output, robot.bus.settings.arm) as journal:
        recorder = Recorder(robot.bus, journal=journal)
        err.print("recording" + (f" for {seconds:g} s" if seconds is not None else "") + "; stop with Ctrl-C")
        if stop.wait(seconds):
            err.print("stopped")
        _write(recorder.recording(), output, mcap, as_json=json)
        journal.remove()
    if journal.failed:
        note(f"{journal.path} could not be written to its end ({journal.failed.strerror})")


@robot_app.command()
def recover(
    journal: Annotated[Path, typer.Argument(help="RECORDING.unfinished, beside the recording to come.")],
    output: opt.LogOutput,
    mcap: Mcap = None,
    json: opt.Json = False,
) -> None:
    """Read what `robot record` or `collect` had heard when it was killed; the file is left as it is.

    Example: gpcorrect robot recover run.parquet.unfinished --output run.parquet
    """
    from gpcorrect.logs import require_writable
    from gpcorrect_service.crtk.recorder import recovered, require_mcap

    require_writable(output)
    require_new(output)
    if mcap is not None:
        require_mcap(mcap)
    _write(recovered(journal), output, mcap, as_json=json)


def _write(recording: Recording, output: Path, mcap: Path | None, *, as_json: bool) -> None:
    from gpcorrect.logs import write_log
    from gpcorrect_service.crtk.recorder import write_mcap

    if mcap is not None:  # first: it holds all that came
        write_mcap(recording, mcap)
    log = recording.log()
    write_log(log, output)
    note(*log.remarks)
    words = f"{len(log)} samples: {', '.join(log.signals)} -> {output}" + (f" and {mcap}" if mcap else "")
    facts = {"samples": len(log), "signals": list(log.signals), "output": str(output), "mcap": mcap and str(mcap)}
    print_result(facts, words, as_json=as_json)


@robot_app.command()
def extract(
    recording: Annotated[Path, typer.Argument(help="A recording: CSV, Parquet, bag, MCAP, C3D.")],
    output: opt.LogOutput,
    signals: Annotated[str | None, typer.Option(help="Signals to keep, with commas; all without it.")] = None,
    begin: Annotated[float | None, typer.Option(help="First second to keep.")] = None,
    end: Annotated[float | None, typer.Option(help="Last second to keep.")] = None,
    every: Annotated[int, typer.Option(help="Keep every n-th sample.", min=1)] = 1,
    columns: opt.Columns = None,
    json: opt.Json = False,
) -> None:
    """Take signals and times out of a recording.

    Example: gpcorrect robot extract run_bag --signals measured_jp,setpoint_jp --begin 5 --every 10 -o part.csv
    """
    from gpcorrect.logs import read_log, require_writable, write_log

    require_writable(output)
    require_new(output)
    log = chosen = read_log(recording, columns=columns)
    if signals is not None:
        wanted = set(split_names(signals, "--signals"))
        if unknown := wanted - set(log.signals):
            hint = f"It holds: {', '.join(log.signals)}."
            raise DataError(f"the recording holds no {', '.join(sorted(unknown))}.", hint=hint)
        without: dict[str, Any] = dict.fromkeys(set(log.signals) - wanted)
        chosen = replace(log, extra={}, **without)
    first, last = -np.inf if begin is None else begin, np.inf if end is None else end
    rows = np.flatnonzero((log.time >= first) & (log.time <= last))[::every]
    if not len(rows):
        whole = f"{log.time.min():.3f} to {log.time.max():.3f} s"
        raise DataError(f"no sample lies between {first:g} and {last:g} s; the recording goes from {whole}.")
    part = chosen.select(rows)
    write_log(part, output)
    facts = {"samples": len(part), "signals": list(part.signals), "output": str(output)}
    words = f"{len(part)} of {len(log)} samples: {', '.join(part.signals)} -> {output}"
    print_result(facts, words, as_json=json)


def _robot(place: opt.RobotPlace) -> Robot:
    from gpcorrect_service.crtk.robot import Robot  # zenoh is an extra; other commands work without it

    return Robot(place.bus)


def _centre(model: Path | None, centre: tuple[float, ...] | None) -> FloatArray:
    """Return the pose (4, 4) that was given, or one in the middle of a model's training."""
    from gpcorrect import se3
    from gpcorrect.calibration import load

    if centre is not None and model is None:
        numbers7 = np.array(centre)
        length = float(np.linalg.norm(numbers7[3:]))
        if not (np.isfinite(numbers7).all() and 0.0 < length < np.inf):
            raise DataError(
                f"a centre is seven numbers whose quaternion is not zero, got {' '.join(f'{x:g}' for x in centre)}.",
                hint="As it stands, a tool has 1 0 0 0.",
            )
        return se3.from_parts(numbers7[:3], numbers7[3:] / length)
    if model is None or centre is not None:
        raise DataError("say where to draw.", hint="Either --model MODEL, or --centre X Y Z QW QX QY QZ.")
    queries = load(model).check_queries
    middle = np.median(queries[:, :3], axis=0)
    nearest = queries[np.argmin(np.linalg.norm(queries[:, :3] - middle, axis=1))]
    return se3.from_parts(nearest[:3], nearest[3:7])
