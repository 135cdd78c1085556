"""`gpcorrect correct`: ask a model file, without a service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
import typer

from gpcorrect import artifact
from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.options import Json
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["Pose", "Position", "Twist", "correct", "correction_dict", "seven_or_three", "show_correction"]

Pose = Annotated[
    tuple[float, float, float, float, float, float, float] | None,
    typer.Option(help="Desired pose: x y z in m, then the unit quaternion qw qx qy qz.", show_default=False),
]
Position = Annotated[
    tuple[float, float, float] | None,
    typer.Option(help="Desired position in m, for a position-only model.", show_default=False),
]
Twist = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(help="Desired velocity: vx vy vz in m/s, then wx wy wz in rad/s.", show_default=False),
]


class Answer(Protocol):
    """What a correction and a service's reply have in common."""

    @property
    def position(self) -> FloatArray: ...
    @property
    def quaternion(self) -> FloatArray | None: ...
    @property
    def std(self) -> FloatArray: ...
    @property
    def interval95(self) -> FloatArray: ...
    @property
    def in_domain(self) -> bool: ...
    @property
    def status(self) -> str: ...
    @property
    def reason(self) -> str: ...


def correct(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    pose: Pose = None,
    position: Position = None,
    twist: Twist = None,
    json: Json = False,
) -> None:
    """Print what to command instead of a desired pose, and how sure that is.

    Example: gpcorrect correct model.gpc --pose 0.1 0.02 -0.11 1 0 0 0 --twist 0.05 0 0 0 0 0
    """
    corrector = artifact.load(model)
    answer = corrector.correct(seven_or_three(pose, position), twist)
    if json:
        print_json(correction_dict(answer))
    else:
        show_correction(answer)


def correction_dict(answer: Answer) -> dict[str, Any]:
    """Return the JSON of one correction: m, rad, wxyz."""
    quaternion = None if answer.quaternion is None else answer.quaternion.tolist()
    return {
        "position": answer.position.tolist(),
        "quaternion": quaternion,
        "std": answer.std.tolist(),
        "interval95": answer.interval95.tolist(),
        "in_domain": answer.in_domain,
        "status": answer.status,
        "reason": answer.reason,
    }


def show_correction(answer: Answer) -> None:
    """Print one correction for people: mm and degrees for what is uncertain."""
    out.print(f"command  position \\[m]     {_numbers(answer.position, 6)}")
    if answer.quaternion is not None:
        out.print(f"         quaternion wxyz  {_numbers(answer.quaternion, 6)}")
    out.print(f"95 %     position \\[mm]    +- {_numbers(1e3 * answer.interval95[:3], 2)}")
    if np.isfinite(answer.interval95[3:]).any():
        out.print(f"         rotation \\[deg]   +- {_numbers(np.rad2deg(answer.interval95[3:]), 2)}")
    out.print(f"status   {answer.status}" + (f": {answer.reason}" if answer.reason else ""))


def _numbers(values: Any, digits: int) -> str:
    return "  ".join(f"{v: .{digits}f}" for v in values)


def seven_or_three(
    pose: tuple[float, float, float, float, float, float, float] | None,
    position: tuple[float, float, float] | None,
) -> tuple[float, ...]:
    """Return the one of `--pose` and `--position` that was given.

    Raises
    ------
    DataError
        None or both were given.
    """
    if (pose is None) == (position is None):
        raise DataError(
            "give the desired pose once.",
            hint="Either --pose X Y Z QW QX QY QZ, or --position X Y Z for position-only models.",
        )
    return pose if pose is not None else position or ()
