"""`gpcorrect prefilter`: the correction before a robot's own servo_cp and move_cp."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gpcorrect import artifact
from gpcorrect.cli.console import err
from gpcorrect.cli.sim import HERE, stop_signal
from gpcorrect.types import FloatArray, PoseSignal

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
    from gpcorrect_service.ops.logger import open_journal
    from gpcorrect_service.server.models import Model

    corrector = artifact.load(model)
    known = Model(corrector, id=model.stem, hash=artifact.model_hash(model))

    def registered(pose: FloatArray) -> FloatArray:
        moved = corrector.rigid.apply(PoseSignal(pose[None, :3], pose[None, 3:]))
        assert moved.quaternion is not None
        return np.concatenate([moved.position[0], moved.quaternion[0]])

    settings = PrefilterSettings(linear / 1e3, float(np.deg2rad(angular)), outside=not strict)
    with Bus(BusSettings(endpoint, arm, namespace, "client", ros_domain), node=f"gpcorrect_prefilter_{arm}") as bus:
        answering = Prefilter(known, corrector, settings, reference=registered)
        server = FilterServer(answering, bus, open_journal(arm=arm))
        err.print(f"{model.name} corrects {namespace}/{arm}/servo_cp on {endpoint}; stop with Ctrl-C")
        server.run(stop_signal())
