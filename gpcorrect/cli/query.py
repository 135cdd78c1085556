"""`gpcorrect query`: ask a running service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.correct import Pose, Position, Twist, correction_dict, seven_or_three, show_correction
from gpcorrect.cli.options import Json

if TYPE_CHECKING:
    from gpcorrect_service import CorrectionClient, Reply

__all__ = ["query_app"]

query_app = typer.Typer(help="Ask a running service.", no_args_is_help=True)

Endpoint = Annotated[str, typer.Option(help="Address of the service.")]
Arm = Annotated[str, typer.Option(help="CRTK name of the arm.")]
Namespace = Annotated[str, typer.Option(help="First part of every key.")]
Timeout = Annotated[float, typer.Option(help="Seconds to wait for an answer, the retry included.")]

Config = Annotated[
    Path | None, typer.Option(help="zenoh configuration (JSON5) instead of --endpoint.", show_default=False)
]

HERE = "tcp/127.0.0.1:7447"


@query_app.command()
def correct(
    pose: Pose = None,
    position: Position = None,
    twist: Twist = None,
    endpoint: Endpoint = HERE,
    arm: Arm = "arm1",
    namespace: Namespace = "gpcorrect",
    encoding: Annotated[str, typer.Option(help="json or msgpack.")] = "msgpack",
    timeout: Timeout = 0.5,
    config: Config = None,
    json: Json = False,
) -> None:
    """Ask what to command instead of a desired pose.

    Example: gpcorrect query correct --pose 0.1 0.02 -0.11 1 0 0 0 --twist 0.05 0 0 0 0 0
    """
    with _client(endpoint, arm, namespace, timeout, config, encoding) as client:
        reply = client.correct(seven_or_three(pose, position), twist)
    if json:
        print_json(_reply_dict(reply))
        return
    show_correction(reply)
    origin = reply.meta
    out.print(f"model    {origin.model_id} {origin.model_hash[:12]}, served by {origin.replica}")


@query_app.command()
def model(
    endpoint: Endpoint = HERE,
    arm: Arm = "arm1",
    namespace: Namespace = "gpcorrect",
    timeout: Timeout = 0.5,
    config: Config = None,
) -> None:
    """Print which model is served: id, hash, frames, features, fit report (JSON)."""
    with _client(endpoint, arm, namespace, timeout, config) as client:
        print_json(_plain(client.model()))


@query_app.command()
def health(
    endpoint: Endpoint = HERE,
    arm: Arm = "arm1",
    namespace: Namespace = "gpcorrect",
    timeout: Timeout = 0.5,
    config: Config = None,
) -> None:
    """Print the state of the service (JSON)."""
    with _client(endpoint, arm, namespace, timeout, config) as client:
        print_json(_plain(client.health()))


@query_app.command()
def metrics(
    endpoint: Endpoint = HERE,
    arm: Arm = "arm1",
    namespace: Namespace = "gpcorrect",
    timeout: Timeout = 0.5,
    config: Config = None,
) -> None:
    """Print the numbers of the service (OpenMetrics text)."""
    with _client(endpoint, arm, namespace, timeout, config) as client:
        typer.echo(client.metrics(), nl=False)


def _client(
    endpoint: str, arm: str, namespace: str, timeout: float, config: Path | None, encoding: str = "msgpack"
) -> CorrectionClient:
    from gpcorrect.errors import DataError
    from gpcorrect_service import CorrectionClient  # zenoh is an extra; other commands work without it

    if encoding not in ("json", "msgpack"):
        raise DataError(f"encoding must be json or msgpack, got {encoding!r}.")
    return CorrectionClient(
        endpoint,
        arm,
        namespace,
        encoding,  # type: ignore[arg-type]  # checked above
        timeout,
        config_file=config,
    )


def _plain(answer: Any) -> Any:
    import msgspec  # comes with the same extra as zenoh

    return msgspec.to_builtins(answer)


def _reply_dict(reply: Reply) -> dict[str, Any]:
    return {**correction_dict(reply), "provenance": _plain(reply.meta)}
