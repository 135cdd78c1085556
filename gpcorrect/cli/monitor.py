"""`gpcorrect monitor`: a local page that shows arms and their corrections live."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Annotated

import typer

from gpcorrect.cli.console import err
from gpcorrect.errors import DataError, MissingExtraError

__all__ = ["monitor"]

HOSTS = ["127.0.0.1", "localhost", "[::1]"]


def monitor(
    connect: Annotated[
        list[str] | None,
        typer.Option(help="Address of a robot or a service, repeatable; both on this machine without it."),
    ] = None,
    namespace: Annotated[str, typer.Option(help="First part of every key.")] = "gpcorrect",
    host: Annotated[str, typer.Option(help="Address to serve the page on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve the page on.", min=1, max=65535)] = 8080,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Serve on an address that other machines can reach.")
    ] = False,
) -> None:
    """Serve a page that shows every arm of a namespace: poses, correction, interval, domain, latency, drift, servers.

    The page reads and can change nothing.

    Example: gpcorrect monitor --connect tcp/127.0.0.1:7448 --connect tcp/127.0.0.1:7447
    """
    for library in ("starlette", "uvicorn"):
        if find_spec(library) is None:
            raise MissingExtraError(library, extra="monitor", purpose="The page")
    if host not in ("127.0.0.1", "localhost", "::1") and not allow_remote:
        raise DataError(
            f"{host} can be reached from other machines, and the page asks nobody who they are.",
            hint="Serve on 127.0.0.1 and tunnel to it, or allow remote access on purpose: --allow-remote",
        )
    import uvicorn

    from gpcorrect_service.monitor import Board, Watcher  # zenoh is an extra; other commands work without it
    from gpcorrect_service.monitor.app import application

    board = Board(namespace)
    names = ["*"] if allow_remote else [*HOSTS, host]
    page = application(board, names, lambda: server.should_exit)
    server = uvicorn.Server(uvicorn.Config(page, host, port, log_level="warning", timeout_graceful_shutdown=2))
    with Watcher(board, connect or ["tcp/127.0.0.1:7448", "tcp/127.0.0.1:7447"]):
        err.print(f"open http://{host}:{port}/ ; stop with Ctrl-C")
        server.run()
