"""`gpcorrect serve`: answer `correct` over zenoh from a model file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gpcorrect.cli.console import err

if TYPE_CHECKING:
    from gpcorrect_service.server import Server

__all__ = ["serve"]


def serve(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    endpoint: Annotated[str, typer.Option(help="Address to listen on.")] = "tcp/127.0.0.1:7447",
    arm: Annotated[str, typer.Option(help="CRTK name of the arm: the second part of every key.")] = "arm1",
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    queue: Annotated[int, typer.Option(help="Requests that may wait; the next one is answered BUSY.")] = 64,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Listen on an address that other machines can reach.")
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(help="zenoh configuration (JSON5) instead of --endpoint.", show_default=False),
    ] = None,
) -> None:
    """Serve a model until stopped with Ctrl-C or SIGTERM: keys correct, correct_path, model, health.

    Example: gpcorrect serve model.gpc --arm PSM1
    """
    from gpcorrect_service import ServerSettings  # zenoh is an extra; other commands work without it
    from gpcorrect_service.server import serve as serve_model

    settings = ServerSettings(
        endpoint=endpoint,
        arm=arm,
        namespace=namespace,
        queue_capacity=queue,
        allow_remote=allow_remote,
        config_file=config,
    )

    def ready(_: Server) -> None:
        err.print(f"serving {model} as {namespace}/{arm}/correct on {config or endpoint}; stop with Ctrl-C")

    serve_model(model, settings, on_ready=ready)
