"""`gpcorrect serve`: answer `correct` over zenoh from a model file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gpcorrect.cli.console import err

if TYPE_CHECKING:
    from gpcorrect_service.server.service import Server

__all__ = ["serve"]


def serve(
    model: Annotated[
        Path | None,
        typer.Argument(help="Model file that `gpcorrect fit` wrote; or the store's active one.", show_default=False),
    ] = None,
    joints: Annotated[
        Path | None, typer.Option(help="Model file that `gpcorrect joint fit` wrote.", show_default=False)
    ] = None,
    store: Annotated[
        Path | None, typer.Option(help="Folder of models to activate from while serving.", show_default=False)
    ] = None,
    endpoint: Annotated[str, typer.Option(help="Address to listen on.")] = "tcp/127.0.0.1:7447",
    arm: Annotated[str, typer.Option(help="CRTK name of the arm: the second part of every key.")] = "arm1",
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    queue: Annotated[int, typer.Option(help="Requests that may wait; the next one is answered BUSY.")] = 64,
    max_rate: Annotated[float, typer.Option(help="Corrections a second; more are answered BUSY.")] = math.inf,
    max_mm: Annotated[float, typer.Option(help="Largest learned correction of position, mm.")] = math.inf,
    max_deg: Annotated[float, typer.Option(help="Largest learned correction of orientation, degrees.")] = math.inf,
    stream_rate: Annotated[
        float, typer.Option(help="Largest change of a streamed joint correction, rad/s and m/s.")
    ] = math.inf,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Listen on an address that other machines can reach.")
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(help="zenoh configuration (JSON5) instead of --endpoint.", show_default=False),
    ] = None,
) -> None:
    """Serve models until stopped with Ctrl-C or SIGTERM: keys correct, correct_path, correct_joints, estimate, health.

    Examples: gpcorrect serve model.gpc --arm PSM1; gpcorrect serve --store models/ --max-mm 5
    """
    from gpcorrect_service import ServerSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.protocol.limits import CorrectionBound
    from gpcorrect_service.server.service import serve as serve_model

    settings = ServerSettings(
        endpoint=endpoint,
        arm=arm,
        namespace=namespace,
        queue_capacity=queue,
        allow_remote=allow_remote,
        config_file=config,
        bound=CorrectionBound(max_mm / 1e3, math.radians(max_deg)),
        max_rate=max_rate,
        stream_rate=stream_rate,
    )

    def ready(_: Server) -> None:
        served = ", ".join(str(path) for path in (model, joints, store) if path is not None)
        err.print(f"serving {served} as {namespace}/{arm}/correct on {config or endpoint}; stop with Ctrl-C")

    serve_model(model, settings, on_ready=ready, joint_path=joints, store=store)
