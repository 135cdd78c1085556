"""Options that several commands share, declared once so that they read alike everywhere."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from gpcorrect.cli.console import note
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog

__all__ = [
    "ROBOT",
    "SERVICE",
    "AlwaysJson",
    "Arm",
    "ArmName",
    "AsIs",
    "Clean",
    "Clock",
    "Columns",
    "Config",
    "Disordered",
    "Endpoint",
    "HoldOutBy",
    "Holdout",
    "Jobs",
    "Json",
    "KeyRoot",
    "LogOutput",
    "Logs",
    "ModelFile",
    "ModelOutput",
    "Namespace",
    "Reading",
    "Remote",
    "RobotPlace",
    "Scheduler",
    "Seed",
    "ServicePlace",
    "Tracker",
    "TrackerLog",
    "numbers",
    "one_of",
    "read_logs",
    "seconds_ahead",
    "takes_groups",
]

# Recordings and models.
Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Recordings: CSV, Parquet, NPY, MATLAB, HDF5, ROS 1 or 2 bags, C3D, TRC, Motive, Vicon, Qualisys, NDI.",
        show_default=False,
    ),
]
Columns = Annotated[
    Path | None, typer.Option(help="Mapping file (TOML) for a foreign table or a bag: which column is what.")
]
Namespace = Annotated[str | None, typer.Option(help="Arm's namespace in a bag that holds several, such as PSM1.")]
Tracker = Annotated[str | None, typer.Option(help="Topic of the outside tracker in a bag.")]
TrackerLog = Annotated[
    Path | None,
    typer.Option(
        help="Recording of the outside tracker on a clock of its own: a Motive, Vicon, Qualisys, NDI, TRC or C3D file.",
        show_default=False,
    ),
]
Arm = Annotated[str | None, typer.Option(help="Which arm of a raven_state topic: left or right.")]
AsIs = Annotated[bool, typer.Option("--as-is", help="Take recordings whose units or frames look wrong as they are.")]
Disordered = Annotated[
    bool, typer.Option("--drop-disordered", help="Leave out samples whose time does not increase, and say how many.")
]
Clock = Annotated[
    str,
    typer.Option(help="Tracker's clock: auto (shift what cannot be robot lag), none, or seconds it runs ahead."),
]
Clean = Annotated[bool, typer.Option("--clean/--no-clean", help="Reject faulty samples first.")]
HoldOutBy = Annotated[
    str,
    typer.Option(
        help="What is held out whole: trajectory, session, block; auto: blocks of a lone motion or of static poses."
    ),
]
Holdout = Annotated[float, typer.Option(help="Fraction of whole trajectories to measure on; 0 for none.")]
Seed = Annotated[int, typer.Option(help="Seed of everything random.", min=0)]
ModelFile = Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)]
ModelOutput = Annotated[Path, typer.Option("--output", "-o", help="Model file to write.", show_default=False)]
LogOutput = Annotated[
    Path, typer.Option("--output", "-o", help="Log to write: CSV or Parquet by its ending.", show_default=False)
]

# What a command prints, and where its work is done.
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
AlwaysJson = Annotated[
    bool, typer.Option("--json", help="Taken, and needless: JSON is printed in any case.", show_default=False)
]
Jobs = Annotated[int, typer.Option(help="Processes of this machine to spread the work over; -1 for one a core.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Dask scheduler to spread the work over, such as tcp://head:8786.", show_default=False),
]

# Robots and services on the network.
ROBOT, SERVICE = "tcp/127.0.0.1:7448", "tcp/127.0.0.1:7449"  # 7447 is zenoh's own, and that of ROS 2's router
Endpoint = Annotated[str, typer.Option(help="Address of the robot or service.")]
ArmName = Annotated[str, typer.Option(help="CRTK name of the arm: the second part of every key.")]
KeyRoot = Annotated[str, typer.Option(help="First part of every key.")]
Config = Annotated[
    Path | None, typer.Option(help="zenoh configuration (JSON5) instead of --endpoint.", show_default=False)
]
Remote = Annotated[bool, typer.Option("--allow-remote", help="Listen on an address that other machines can reach.")]


@dataclass(frozen=True)
class Reading:
    """How the recordings of a command are read; its fields become options of the command."""

    columns: Columns = None
    time_offset: Clock = "auto"
    namespace: Namespace = None
    tracker_topic: Tracker = None
    tracker_log: TrackerLog = None
    arm: Arm = None
    as_is: AsIs = False
    drop_disordered: Disordered = False

    def log(self, paths: list[Path]) -> CalibrationLog:
        """Read the recordings as :func:`read_logs` does."""
        return read_logs(paths, **{field.name: getattr(self, field.name) for field in fields(self)})

    @property
    def clock_left(self) -> str:
        """What is left to do about the tracker's clock after a tracker's recording was put beside the robot's."""
        return self.time_offset if self.tracker_log is None or self.time_offset == "auto" else "none"


@dataclass(frozen=True)
class RobotPlace:
    """Where a robot is on the network; its fields become options of the command."""

    endpoint: Endpoint = ROBOT
    arm: ArmName = "arm1"
    namespace: KeyRoot = "gpcorrect"
    config: Config = None


@dataclass(frozen=True)
class ServicePlace(RobotPlace):
    """Where a service is on the network."""

    endpoint: Endpoint = SERVICE


def takes_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command options in the place of each parameter that is a dataclass of options, as :class:`Reading` is.

    Parameters
    ----------
    command : callable
        Function of a command.

    Returns
    -------
    callable
        The same command; its signature has an option for every field.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    keywords = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name in groups:
            options = get_type_hints(groups[name], include_extras=True)
            keywords += [
                parameter.replace(name=f.name, default=f.default, annotation=options[f.name])
                for f in fields(groups[name])
            ]
        else:
            keywords.append(parameter.replace(annotation=hints[name]))

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        made = {n: group(**{f.name: values.pop(f.name) for f in fields(group)}) for n, group in groups.items()}
        command(**made, **values)

    wrapped.__annotations__ = {p.name: p.annotation for p in keywords} | {"return": None}
    keywords = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in keywords]
    wrapped.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]  # what inspect looks for
    return wrapped


def read_logs(
    paths: list[Path],
    columns: Path | None = None,
    *,
    as_is: bool | None = None,
    drop_disordered: bool = False,
    namespace: str | None = None,
    tracker_topic: str | None = None,
    arm: str | None = None,
    tracker_log: Path | None = None,
    time_offset: str = "auto",
    learned: Collection[str] = ("setpoint_cp", "tracker_cp"),
) -> CalibrationLog:
    """Read the recordings and join them into one log; put the tracker of another recording beside the only one.

    Parameters
    ----------
    paths : list of Path
        Recordings.
    columns : Path, optional
        Mapping file.
    as_is, drop_disordered : bool
        Take what looks misread (None where the command has no such option); leave out samples whose time does not
        increase.
    namespace, tracker_topic, arm : str, optional
        Which arm and tracker of a bag.
    tracker_log : Path, optional
        The tracker's own recording.
    time_offset : str
        "auto", "none", or the seconds that its clock runs ahead.
    learned : collection of str
        Signals that the command learns from or measures.

    Returns
    -------
    CalibrationLog
        All of them, one session a recording.

    Raises
    ------
    LogError
        One of them cannot be read, or cannot be in the units and frames it is taken for, unless taken `as_is`; or the
        tracker's recording does not go with the robot's; or one was given twice.
    """
    from gpcorrect.logs import join_logs, read_log, refuse_misread, with_tracker

    disorder = "drop" if drop_disordered else "refuse"
    chosen: dict[str, Any] = {"namespace": namespace, "tracker_topic": tracker_topic, "arm": arm, "disorder": disorder}
    logs = [read_log(path, columns=columns, **chosen) for path in paths]
    if tracker_log is not None:
        if len(logs) > 1:
            raise LogError("--tracker-log goes with one recording of the robot.", hint="Give them one at a time.")
        logs = [with_tracker(logs[0], read_log(tracker_log, columns=columns), seconds_ahead(time_offset))]
    for log in logs:
        try:
            for found in refuse_misread(log, learned, as_is=bool(as_is)):
                note(f"{log.name}: {f'{found.signal}: ' if found.signal else ''}{found.message}")
        except LogError as error:  # name the way past the refusal too
            past = "" if as_is is None else " If you know better: --as-is"
            hint = f"{error.hint} More: gpcorrect validate LOG.{past}"
            raise LogError(error.message, hint=hint) from error
    return logs[0] if len(logs) == 1 else join_logs(logs)


def seconds_ahead(time_offset: str) -> float | None:
    """Return the seconds that the tracker's clock runs ahead; None when the motion is to tell.

    Parameters
    ----------
    time_offset : str
        "auto", "none", or seconds.
    """
    from gpcorrect.logs.sync import seconds_of

    return {"auto": None, "none": 0.0}[time_offset] if time_offset in ("auto", "none") else seconds_of(time_offset)


def numbers(text: str, separator: str, count: int, what: str) -> list[float]:
    """Return the numbers of a text.

    Parameters
    ----------
    text, separator : str
        The text, and what stands between two numbers.
    count : int
        How many there must be.
    what : str
        What they are, for the message.

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


def one_of(chosen: str | None, choices: tuple[Any, ...], what: str) -> Any:
    """Return the choice that was given by its name.

    Parameters
    ----------
    chosen : str or None
        What was given.
    choices : tuple
        What may be given.
    what : str
        Begins the message, such as "the marker".

    Raises
    ------
    DataError
        It is none of the choices.
    """
    for choice in choices:
        if chosen == choice:
            return choice
    names = [str(choice) for choice in choices if choice is not None]
    raise DataError(f"{what} is {', '.join(names[:-1])} or {names[-1]}; got {chosen!r}.")
