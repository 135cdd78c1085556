"""Options that several commands share, so that they read alike everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gpcorrect.corrector.clocks import seconds_of
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import join_logs, read_log, refuse_misread, with_tracker
from gpcorrect.types import CalibrationLog

__all__ = [
    "Arm",
    "AsIs",
    "Columns",
    "Disordered",
    "Jobs",
    "Json",
    "Logs",
    "Namespace",
    "Scheduler",
    "Tracker",
    "TrackerLog",
    "clock_left",
    "read_logs",
    "seconds_ahead",
    "seven_or_three",
]

Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Recordings: CSV, Parquet, NPY, MATLAB, ROS 1 or ROS 2 bags, C3D, TRC, Motive, Vicon.", show_default=False
    ),
]
Columns = Annotated[
    Path | None, typer.Option(help="Mapping file (TOML) for a foreign table or a bag: which column is what.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
Namespace = Annotated[str | None, typer.Option(help="Arm's namespace in a bag that holds several, such as PSM1.")]
Tracker = Annotated[str | None, typer.Option(help="Topic of the outside tracker in a bag.")]
TrackerLog = Annotated[
    Path | None,
    typer.Option(
        help="Recording of the outside tracker on a clock of its own: a Motive, Vicon, TRC or C3D file.",
        show_default=False,
    ),
]
Arm = Annotated[str | None, typer.Option(help="Which arm of a raven_state topic: left or right.")]

Jobs = Annotated[int, typer.Option(help="Processes of this machine to spread the work over; -1 for one a core.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Dask scheduler to spread the work over, such as tcp://head:8786.", show_default=False),
]
AsIs = Annotated[bool, typer.Option("--as-is", help="Take recordings whose units or frames look wrong as they are.")]
Disordered = Annotated[
    bool, typer.Option("--drop-disordered", help="Leave out samples whose time does not increase, and say how many.")
]


def read_logs(
    paths: list[Path],
    columns: Path | None = None,
    *,
    as_is: bool = False,
    drop_disordered: bool = False,
    namespace: str | None = None,
    tracker_topic: str | None = None,
    arm: str | None = None,
    tracker_log: Path | None = None,
    time_offset: str = "auto",
) -> CalibrationLog:
    """Read the recordings and join them into one log; put the tracker of another recording beside the only one.

    Raises
    ------
    LogError
        One of them cannot be read, or cannot be in the units and frames it is taken for, unless taken `as_is`; or the
        tracker's recording does not go with the robot's.
    """
    logs = [
        read_log(
            path,
            columns=columns,
            disorder="drop" if drop_disordered else "refuse",
            namespace=namespace,
            tracker_topic=tracker_topic,
            arm=arm,
        )
        for path in paths
    ]
    if tracker_log is not None:
        if len(logs) > 1:
            raise LogError("--tracker-log goes with one recording of the robot.", hint="Give them one at a time.")
        logs = [with_tracker(logs[0], read_log(tracker_log, columns=columns), seconds_ahead(time_offset))]
    for log in [] if as_is else logs:
        _refuse_misread(log)
    return logs[0] if len(logs) == 1 else join_logs(logs)


def seconds_ahead(time_offset: str) -> float | None:
    """Return the seconds that the tracker's clock runs ahead; None when the motion is to tell."""
    if time_offset in ("auto", "none"):
        return None if time_offset == "auto" else 0.0
    return seconds_of(time_offset)


def clock_left(time_offset: str, tracker_log: Path | None) -> str:
    """Say what is left to do about the tracker's clock after a tracker's recording was put beside the robot's."""
    return time_offset if tracker_log is None or time_offset == "auto" else "none"


def _refuse_misread(log: CalibrationLog) -> None:
    """Name the way past the refusal too."""
    try:
        refuse_misread(log)
    except LogError as error:
        hint = f"{error.hint} More: gpcorrect validate LOG. If you know better: --as-is"
        raise LogError(error.message, hint=hint) from error


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
