"""`gpcorrect zigzag`: a calibration trajectory to drive, its duration, and a picture of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gpcorrect.arms import arm_named
from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.options import Json
from gpcorrect.errors import DataError
from gpcorrect.joint import TimedPath, direction_named, timed, zigzag
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta

__all__ = ["joint_limits", "numbers", "zigzag_command"]

ROUNDING = 1e-9  # rad and m: of limits written in degrees and millimetres
UNIT = np.array([np.deg2rad(1.0), np.deg2rad(1.0), 1e-3])


def zigzag_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Trajectory to write, native log format.", show_default=False)
    ],
    direction: Annotated[
        str, typer.Option(help="Joints along which it runs: J1, J2, J3, J1-J2, J2-J3, J1-J3 or J1-J2-J3.")
    ] = "J1",
    sparsity: Annotated[int, typer.Option(help="n: stripes lie 1/n of the block's side apart.")] = 4,
    limits: Annotated[str, typer.Option(help="LOW:HIGH of joints 1, 2 (deg) and 3 (mm).")] = "20:60,55:110,330:420",
    arm: Annotated[
        str, typer.Option(help="Arm whose limits must hold: raven2_left, raven2_right, dvrk_psm, or none.")
    ] = "raven2_left",
    speed: Annotated[str, typer.Option(help="Speed limits of joints 1, 2 (deg/s) and 3 (mm/s).")] = "5,5,20",
    rate: Annotated[float, typer.Option(help="Samples a second.")] = 30.0,
    plot: Annotated[Path | None, typer.Option(help="Picture to write (PNG).", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Write a zig-zag calibration trajectory for the first three joints, within their speed limits.

    Every direction sweeps a block of the same centre and volume, so their models can be compared.

    For example:

    gpcorrect zigzag --direction J2-J3 --sparsity 4 --limits 20:60,55:110,330:420 --output traj.csv --plot traj.png
    """
    require_folder(output)
    chosen = direction_named(direction)
    block = joint_limits(limits)
    if arm != "none":
        _require_within(block, arm)
    corners = zigzag(chosen, sparsity, block)
    path = timed(corners, UNIT * np.array(numbers(speed, ",", 3, "speed limits")), rate)
    write_log(_log(path), output)
    title = f"zig-zag {chosen}, sparsity 1/{sparsity}: {path.duration / 60:.1f} min"
    if plot is not None:
        _draw(path, title, plot)
    facts = {
        "direction": chosen,
        "sparsity": sparsity,
        "corners": len(corners),
        "samples": len(path.time),
        "seconds": path.duration,
        "output": str(output),
    }
    if json:
        print_json(facts)
    else:
        out.print(f"{title}, {len(corners)} corners, {len(path.time)} samples -> {output}")


def _require_within(block: FloatArray, name: str) -> None:
    """Refuse a block that the arm's own limits do not hold."""
    allowed = arm_named(name).limits[: len(block)]
    for joint, ((low, high), (least, most), unit) in enumerate(zip(block, allowed, UNIT, strict=True), start=1):
        if low < least - ROUNDING or high > most + ROUNDING:
            raise DataError(
                f"joint {joint} would go from {low / unit:g} to {high / unit:g}, beyond the limits of {name}, "
                f"{least / unit:g} to {most / unit:g}.",
                hint="Narrow --limits, name another --arm, or give --arm none.",
            )


def _log(path: TimedPath) -> CalibrationLog:
    still = np.zeros(len(path.time), dtype=np.int64)
    return CalibrationLog(path.time, still, still, setpoint_jp=path.q, meta=LogMeta(joint_types="RRP"))


def _draw(path: TimedPath, title: str, plot: Path) -> None:
    from gpcorrect.plots import joint_trajectory, png  # drawing is an extra

    require_folder(plot)
    with atomic_path(plot) as temporary:
        temporary.write_bytes(png(joint_trajectory(path.time, path.q, title)))


def joint_limits(text: str) -> FloatArray:
    """Return (3, 2) limits, rad and m, of a text of three pairs LOW:HIGH in deg, deg and mm.

    Raises
    ------
    DataError
        It is no such text.
    """
    pairs = text.split(",")
    if len(pairs) != len(UNIT):
        raise DataError(f"limits are three pairs LOW:HIGH, got {text!r}.", hint="For example 20:60,55:110,330:420")
    limits: FloatArray = UNIT[:, None] * np.array([numbers(pair, ":", 2, "limits") for pair in pairs])
    return limits


def numbers(text: str, separator: str, count: int, what: str) -> list[float]:
    """Return the `count` numbers of a text.

    Raises
    ------
    DataError
        There are more or fewer, or they are no numbers.
    """
    try:
        found = [float(part) for part in text.split(separator)]
    except ValueError as error:
        raise DataError(f"{what} must be numbers, got {text!r}.") from error
    if len(found) != count:
        raise DataError(f"{what} need {count} numbers separated by {separator!r}, got {text!r}.")
    return found
