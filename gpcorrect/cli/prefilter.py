"""`gpcorrect prefilter`: the correction before a robot's own servo_cp and move_cp."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from gpcorrect.cli.console import err
from gpcorrect.cli.sim import HERE, stop_signal

__all__ = ["prefilter"]


def prefilter(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    endpoint: Annotated[str, typer.Option(help="Address of the robot.")] = HERE,
    arm: Annotated[str, typer.Option(help="CRTK name of the arm.")] = "arm1",
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    linear: Annotated[float, typer.Option(help="Fastest change of the correction, mm/s.")] = 50.0,
    angular: Annotated[float, typer.Option(help="Fastest change of the correction, deg/s.")] = 60.0,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse poses out of the model's domain.")] = False,
    ros_domain: Annotated[
        int | None, typer.Option(help="Speak on rmw_zenoh's keys too, in this ROS_DOMAIN_ID.", show_default=False)
    ] = None,
) -> None:
    """Correct a stream of desired poses before the robot sees them, until Ctrl-C or SIGTERM.

    Desired poses on NAMESPACE/ARM/servo_cp and move_cp, in the frame that the model was trained in, come out as
    commands on NAMESPACE/ARM/corrected/servo_cp and corrected/move_cp. Refused while the robot is not ENABLED and
    homed, and without a stamp; why is said on NAMESPACE/ARM/error.

    Example: gpcorrect sim serve --corrected --ready, and in another terminal gpcorrect prefilter model.gpc
    """
    from gpcorrect_service.crtk import Bus, BusSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.crtk.filter_server import FilterServer
    from gpcorrect_service.crtk.prefilter import Prefilter, PrefilterSettings
    from gpcorrect_service.ops.logger import open_logger
    from gpcorrect_service.server.models import load_model

    settings = PrefilterSettings(linear / 1e3, math.radians(angular), outside=not strict)
    answering = Prefilter(load_model(model), settings)
    with Bus(BusSettings(endpoint, arm, namespace, "client", ros_domain), node=f"gpcorrect_prefilter_{arm}") as bus:
        server = FilterServer(answering, bus, open_logger(arm=arm))
        err.print(f"{model.name} corrects {namespace}/{arm}/servo_cp on {endpoint}; stop with Ctrl-C")
        server.run(stop_signal())
