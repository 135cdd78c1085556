"""`gpcorrect sim`: simulated arms that run live."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Annotated

import numpy as np
import typer

from gpcorrect.cli.console import err
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of, preset, read_model
from gpcorrect.sim.live_robot import LiveRobot

__all__ = ["HERE", "sim_app", "stop_signal"]

sim_app = typer.Typer(no_args_is_help=True, help="Simulated arms that run live.")

HERE = "tcp/127.0.0.1:7448"
LARGEST_RATE = 1000.0
LONGEST_BLOCK = 20  # servo steps


@sim_app.command()
def serve(
    model: Annotated[
        Path | None, typer.Option(help="Machine to simulate (TOML); a packaged one without it.", show_default=False)
    ] = None,
    machine: Annotated[str, typer.Option(help="Packaged machine.")] = "raven2_debridement",
    arm: Annotated[str, typer.Option(help="CRTK name of the arm: the second part of every key.")] = "arm1",
    endpoint: Annotated[str, typer.Option(help="Address to listen on.")] = HERE,
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    rate: Annotated[float, typer.Option(help="State messages a second, up to 1000.")] = 100.0,
    time_scale: Annotated[float, typer.Option(help="How many times faster than a real arm it lives.")] = 1.0,
    corrected: Annotated[
        bool, typer.Option("--corrected", help="Take poses from the pre-filter only: gpcorrect prefilter.")
    ] = False,
    ready: Annotated[bool, typer.Option("--ready", help="Start ENABLED and homed.")] = False,
    ros_domain: Annotated[
        int | None, typer.Option(help="Speak on rmw_zenoh's keys too, in this ROS_DOMAIN_ID.", show_default=False)
    ] = None,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Listen on an address that other machines can reach.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.", min=0)] = 0,
) -> None:
    """Run an arm that speaks CRTK over zenoh until Ctrl-C or SIGTERM.

    It publishes measured_js, measured_cp, setpoint_js, setpoint_cp, external_js, tracker_cp, operating_state and
    heartbeat; it obeys servo_jp, servo_cp, move_jp, move_cp and state_command, and says on `error` why it does not.

    For example:

    gpcorrect sim serve --rate 1000 --arm PSM1 --machine dvrk_psm

    gpcorrect sim serve --ready --ros-domain 0
    """
    from gpcorrect_service.crtk import ArmServer, ArmServerSettings, Bus, BusSettings  # zenoh is an extra

    if not 1.0 <= rate <= LARGEST_RATE or not time_scale > 0:
        raise DataError(f"the rate goes from 1 to {LARGEST_RATE:.0f} Hz and time forward, got {rate}, {time_scale}.")
    known = preset(machine) if model is None else read_model(model)
    real = machine_of(known)
    robot = LiveRobot(
        real, np.random.default_rng(seed), block=max(1, min(LONGEST_BLOCK, round(real.drive.rate_hz / rate)))
    )
    robot.advance(0.01)  # compiles what is compiled at first use
    if ready:
        robot.operate("enable")
        robot.operate("home")
    settings = BusSettings(endpoint, arm, namespace, "hub", ros_domain, allow_remote)
    with Bus(settings, node=f"gpcorrect_sim_{arm}") as bus:
        server = ArmServer(robot, bus, ArmServerSettings(rate, 100.0, time_scale, corrected), time.time())
        err.print(f"{known.arm} lives as {namespace}/{arm} on {endpoint} at {rate:g} Hz; stop with Ctrl-C")
        server.run(stop_signal())


def stop_signal() -> threading.Event:
    """Return an event that Ctrl-C and SIGTERM set; needs the main thread."""
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    return stop
