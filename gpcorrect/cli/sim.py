"""`gpcorrect simulate` and `sim serve`: recordings of simulated cable-driven arms, and arms that run live."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gpcorrect.atomic import require_new
from gpcorrect.cli import options as opt
from gpcorrect.cli.console import err, print_result
from gpcorrect.cli.processes import stop_signal
from gpcorrect.cli.reading import model_named
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect.sim import Effect, Model

sim_app = typer.Typer(no_args_is_help=True)


COUNTS = {"debridement": 303, "reaches": 40, "joints": 24}  # motions of a task; the paper had 303 reaches
TAKES = {  # options that one task takes and another does not
    "debridement": ("--clean", "--position-only"),
    "reaches": ("--sessions", "--payload", "--clean", "--position-only"),
    "joints": ("--seconds", "--sessions", "--payload"),
}
SECONDS = 20.0  # of a motion of joints; chosen by hand


def simulate(
    task: Annotated[
        str | None, typer.Argument(help="debridement (default), reaches, or joints (default with --model).")
    ] = None,
    output: opt.LogOutput = Path("log.csv"),
    machine: opt.Machine = None,
    reaches: Annotated[int | None, typer.Option("--reaches", "--trajectories", help="How many motions.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help=f"Length of each motion, for joints; {SECONDS:g} without it.")
    ] = None,
    sessions: Annotated[int, typer.Option(help="Sessions, with a homing before each, for reaches and joints.")] = 1,
    payload: Annotated[
        list[float] | None, typer.Option(help="Payload in kg, in turn for reaches and joints. Repeatable.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Further effect: its name, joint and numbers (docs/simulator.md). Repeatable."),
    ] = None,
    noise: Annotated[
        float | None, typer.Option(help="Noise of outside joint sensors, rad and m; the model's own without it.", min=0)
    ] = None,
    clean: Annotated[
        bool, typer.Option("--clean", help="A tracker without occlusions and outliers, not for joints.")
    ] = False,
    position_only: Annotated[
        bool, typer.Option("--position-only", help="A tracker that sees positions only, not for joints.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of motion, noise and faults.", min=0)] = 0,
    old_arm: opt.OldArm = None,
    json: opt.Json = False,
) -> None:
    """Simulate a recording: what was commanded, reported, and seen by an outside tracker, faults included.

    For example:

    gpcorrect simulate debridement --output reaches.csv

    gpcorrect simulate reaches --machine dvrk_psm --reaches 60 --output psm.parquet

    gpcorrect simulate joints --machine model.toml --seed 3 --output joints.csv

    gpcorrect simulate joints --machine robot.xml --effect "backlash joint=2 radius=0.004" --noise 1e-4
    """
    from gpcorrect.logs import require_writable, write_log
    from gpcorrect.logs.native import read_sidecar
    from gpcorrect.sim import SIMULATED, debridement_log, joint_motion_log, random_reaches_log

    require_writable(output)
    if read_sidecar(output).robot != SIMULATED:
        require_new(output)
    model = None if machine is None else _altered(model_named(machine), effect or (), noise)
    if model is None and (effect or noise is not None):
        raise DataError("effects and noise are added to a machine.", hint="Give it: --machine model.toml")
    chosen = task or ("debridement" if model is None else "joints")
    if chosen not in COUNTS:
        raise DataError(f"a task is one of {', '.join(COUNTS)}; got {chosen!r}.")
    beside = {"--seconds": seconds is not None, "--sessions": sessions != 1, "--payload": bool(payload)}
    beside |= {"--clean": clean, "--position-only": position_only}
    _refuse_others(chosen, [name for name, given in beside.items() if given])
    count = COUNTS[chosen] if reaches is None else reaches
    if chosen == "debridement":
        log = debridement_log(seed, reaches=count, faults=not clean, position_only=position_only, model=model)
    elif chosen == "reaches":
        how: dict[str, Any] = {"sessions": sessions, "payloads": payload or (), "position_only": position_only}
        log = random_reaches_log("raven2_left", count, seed, faults=not clean, model=model, **how)
    elif model is None:
        raise DataError("joint motion needs to know the machine.", hint="Give it: --machine model.toml")
    else:
        log = joint_motion_log(
            model, count, SECONDS if seconds is None else seconds, seed, sessions=sessions, payloads=payload or ()
        )
    write_log(log, output)
    count = len(log.trajectory_ids)
    print_result(
        {"samples": len(log), "trajectories": count, "signals": list(log.signals), "output": str(output)},
        f"{len(log)} samples, {count} trajectories: {', '.join(log.signals)} -> {output}",
        as_json=json,
    )


def _refuse_others(task: str, given: Sequence[str]) -> None:
    """Refuse options that a task does not take."""
    if others := [name for name in given if name not in TAKES[task]]:
        takers = [name for name, takes in TAKES.items() if set(others) <= set(takes)]
        hint = f"Leave it out, or simulate {' or '.join(takers)}." if takers else "Leave them out."
        raise DataError(f"simulate {task} takes no {' and no '.join(others)}.", hint=hint)


def _altered(model: Model, effects: Sequence[str], noise: float | None) -> Model:
    """Return a model with further effects, and with this noise on outside joint sensors."""
    from gpcorrect.sim.settings import Noise

    if noise is not None:
        sensors = (model.noise or Noise()).model_copy(update={"external_jp_white": (noise,) * len(model.joints)})
        model = model.model_copy(update={"noise": sensors})
    return model.with_effects(*model.effects, *map(_effect, effects))


def _effect(text: str) -> Effect:
    """Return the effect of a text as "backlash joint=2 radius=0.004"."""
    from gpcorrect.sim import effect_from_dict

    name, *fields = text.split() or [""]
    try:
        values = tomllib.loads("\n".join(fields))
    except tomllib.TOMLDecodeError as error:
        hint = 'For example: --effect "backlash joint=2 radius=0.004"'
        raise DataError(f"an effect is a name and fields with numbers, got {text!r}.", hint=hint) from error
    return effect_from_dict({"name": name} | values)


@sim_app.command()
def serve(
    machine: opt.Machine = None,
    arm: opt.ArmName = "arm1",
    endpoint: opt.Listen = opt.ROBOT,
    namespace: opt.KeyRoot = "gpcorrect",
    rate: Annotated[float, typer.Option(help="State messages a second.", min=1.0, max=1000.0)] = 100.0,
    time_scale: Annotated[float, typer.Option(help="How many times faster than a real arm it lives.", min=0.001)] = 1.0,
    corrected: Annotated[
        bool, typer.Option("--corrected", help="Take poses from the pre-filter only: gpcorrect prefilter.")
    ] = False,
    ready: Annotated[bool, typer.Option("--ready", help="Start ENABLED and homed.")] = False,
    ros_domain: opt.RosDomain = None,
    ros_distro: opt.RosName = None,
    allow_remote: opt.Remote = False,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.", min=0)] = 0,
    config: opt.Config = None,
) -> None:
    """Run an arm that speaks CRTK over zenoh until Ctrl-C or SIGTERM.

    It publishes measured_js, measured_cp, setpoint_js, setpoint_cp, external_js, tracker_cp, operating_state and
    heartbeat; it obeys servo_jp, servo_cp, move_jp, move_cp and state_command, and says on `error` why it does not.

    For example:

    gpcorrect sim serve --rate 1000 --arm PSM1 --machine dvrk_psm

    gpcorrect sim serve --ready --ros-domain 0 --ros-distro humble

    gpcorrect sim serve --ready --corrected --config site/robot.json5
    """
    stop = stop_signal()
    import numpy as np

    from gpcorrect.sim import machine_of
    from gpcorrect.sim.live_robot import LiveRobot
    from gpcorrect_service.crtk import ArmServer, ArmServerSettings, Bus, BusSettings  # zenoh is an extra

    distro = opt.ros_distro_of(ros_distro, ros_domain)
    known = model_named(machine or "raven2_debridement")
    real = machine_of(known)
    block = max(1, min(20, round(real.drive.rate_hz / rate)))  # servo steps taken at once; chosen by hand
    robot = LiveRobot(real, np.random.default_rng(seed), block=block)
    robot.advance(0.01)  # compiles what is compiled at first use
    if ready:
        robot.operate("enable")
        robot.operate("home")
    role: Literal["hub", "client"] = "hub" if config is None else "client"  # behind a secured site's router
    settings = BusSettings(endpoint, arm, namespace, role, ros_domain, distro, allow_remote, config_file=config)
    with Bus(settings, node=f"gpcorrect_sim_{arm}") as bus:
        server = ArmServer(robot, bus, ArmServerSettings(rate, time_scale, corrected), time.time())
        err.print(
            f"{known.arm} lives as {bus.settings.namespace}/{arm} on {settings.where} at {rate:g} Hz; stop with Ctrl-C"
        )
        server.run(stop)
