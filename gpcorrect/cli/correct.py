"""`gpcorrect correct` and `query`: ask a model file, or a running service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.options import AlwaysJson, Json, ModelFile, ServicePlace, one_of
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect.correction import Correction
    from gpcorrect_service import CorrectionClient, Reply

query_app = typer.Typer(no_args_is_help=True)

Pose = Annotated[
    tuple[float, float, float, float, float, float, float] | None,
    typer.Option(help="Desired pose: x y z in m, then the unit quaternion qw qx qy qz."),
]
Position = Annotated[
    tuple[float, float, float] | None, typer.Option(help="Desired position in m, for a position-only model.")
]
Twist = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(help="Desired velocity: vx vy vz in m/s, then wx wy wz in rad/s."),
]
Timeout = Annotated[float, typer.Option(help="Seconds to wait for an answer, the retry included.")]


def correct(
    model: ModelFile,
    pose: Pose = None,
    position: Position = None,
    twist: Twist = None,
    reached: Annotated[
        bool,
        typer.Option(
            "--reached",
            help="The other way round: pose and velocity are commanded ones, and what is printed is the pose reached.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Print what to command instead of a desired pose, and how sure that is.

    Example: gpcorrect correct model.gpc --pose 0.1 0.02 -0.11 1 0 0 0 --twist 0.05 0 0 0 0 0

    Example: gpcorrect correct model.gpc --pose 0.1 0.02 -0.11 1 0 0 0 --reached
    """
    from gpcorrect import calibration

    corrector, asked = calibration.load(model), _desired(pose, position)
    if reached:
        answer = calibration.reached(corrector, [asked], None if twist is None else [twist])[0]
    else:
        answer = corrector.correct(asked, twist)
    if json:
        print_json(_answer_dict(answer))
    else:
        _show_answer(answer, "reached" if reached else "command")


@query_app.command("correct")
def query_correct(
    pose: Pose = None,
    position: Position = None,
    twist: Twist = None,
    *,
    place: ServicePlace,
    encoding: Annotated[str, typer.Option(help="json or msgpack.")] = "msgpack",
    timeout: Timeout = 0.5,
    json: Json = False,
) -> None:
    """Ask what to command instead of a desired pose.

    Example: gpcorrect query correct --pose 0.1 0.02 -0.11 1 0 0 0 --twist 0.05 0 0 0 0 0
    """
    with _client(place, timeout, encoding) as client:
        reply = client.correct(_desired(pose, position), twist)
    if json:
        print_json({**_answer_dict(reply), "provenance": _plain(reply.meta)})
        return
    _show_answer(reply)
    origin = reply.meta
    out.print(f"model    {origin.model_id} {origin.model_hash[:12]}, served by {origin.replica}")


@query_app.command()
def model(place: ServicePlace, timeout: Timeout = 0.5, json: AlwaysJson = True) -> None:
    """Print which model is served: id, hash, frames, features, fit report (JSON)."""
    with _client(place, timeout) as client:
        print_json(_plain(client.model()))


@query_app.command()
def health(place: ServicePlace, timeout: Timeout = 0.5, json: AlwaysJson = True) -> None:
    """Print the state of the service (JSON)."""
    with _client(place, timeout) as client:
        print_json(_plain(client.health()))


@query_app.command()
def metrics(place: ServicePlace, timeout: Timeout = 0.5) -> None:
    """Print the numbers of the service (OpenMetrics text)."""
    with _client(place, timeout) as client:
        typer.echo(client.metrics(), nl=False)


def _client(place: ServicePlace, timeout: float, encoding: str = "msgpack") -> CorrectionClient:
    from gpcorrect_service import CorrectionClient  # zenoh is an extra; other commands work without it

    chosen = one_of(encoding, ("json", "msgpack"), "the encoding")
    return CorrectionClient(place.endpoint, place.arm, place.namespace, chosen, timeout, config_file=place.config)


def _plain(answer: Any) -> Any:
    import msgspec  # comes with the same extra as zenoh

    return msgspec.to_builtins(answer)


def _desired(pose: tuple[float, ...] | None, position: tuple[float, ...] | None) -> tuple[float, ...]:
    """Return the one of `--pose` and `--position` that was given."""
    if (pose is None) == (position is None):
        hint = "Either --pose X Y Z QW QX QY QZ, or --position X Y Z for position-only models."
        raise DataError("give the desired pose once.", hint=hint)
    return pose or position or ()


def _answer_dict(answer: Correction | Reply) -> dict[str, Any]:
    """Return the JSON of one correction: m, rad, wxyz."""
    names = ("position", "quaternion", "std", "interval95", "in_domain", "status", "reason")
    return {name: getattr(answer, name) for name in names}


def _show_answer(answer: Correction | Reply, name: str = "command") -> None:
    """Print one correction, or the pose that is reached, for people: mm and degrees for what is uncertain."""
    import numpy as np

    out.print(f"{name}  position [m]     {_numbers(answer.position, 6)}")
    if answer.quaternion is not None:
        out.print(f"         quaternion wxyz  {_numbers(answer.quaternion, 6)}")
    out.print(f"95 %     position [mm]    +- {_numbers(1e3 * answer.interval95[:3], 2)}")
    if np.isfinite(answer.interval95[3:]).any():
        out.print(f"         rotation [deg]   +- {_numbers(np.rad2deg(answer.interval95[3:]), 2)}")
    out.print(f"status   {answer.status}" + (f": {answer.reason}" if answer.reason else ""))


def _numbers(values: Any, digits: int) -> str:
    return "  ".join(f"{v: .{digits}f}" for v in values)
