"""Options that several commands share, declared once so that they read alike everywhere."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from gpcorrect.atomic import make_folder, require_folder
from gpcorrect.cli.console import note
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from gpcorrect.arms import Chain
    from gpcorrect.sim import Model

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
    "Machine",
    "MachineName",
    "ModelFile",
    "ModelOutput",
    "OldArm",
    "OldConnect",
    "OldNamespace",
    "OldPage",
    "Reading",
    "Remote",
    "Report",
    "RobotPlace",
    "Scheduler",
    "Seed",
    "ServicePlace",
    "Tracker",
    "TrackerLog",
    "arm_chosen",
    "chain_of",
    "model_named",
    "numbers",
    "one_of",
    "read_logs",
    "renamed",
    "report_page",
    "seconds_ahead",
    "takes_groups",
]


def renamed(old: str, new: str, why: str) -> Any:
    """Return the hidden option that refuses a name which an option had, and says the new one.

    Parameters
    ----------
    old, new : str
        Names of the option, with their dashes.
    why : str
        What the old name means elsewhere.
    """

    def _refuse(value: Any) -> None:
        if value:
            raise DataError(f"{old} is not taken here: {why}.", hint=f"Give {new} instead of {old}.")

    return typer.Option(old, hidden=True, callback=_refuse)


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
Tracker = Annotated[str | None, typer.Option(help="Topic of the outside tracker in a bag.")]
TrackerLog = Annotated[
    Path | None,
    typer.Option(
        help="Recording of the outside tracker on a clock of its own: a Motive, Vicon, Qualisys, NDI, TRC or C3D file.",
        show_default=False,
    ),
]
Arm = Annotated[
    str | None,
    typer.Option(help="Which arm of a recording that holds several: PSM1, as its topics name it; left or right."),
]
OldNamespace = Annotated[str | None, renamed("--namespace", "--arm", "it is the first part of the keys on the network")]
OldConnect = Annotated[list[str] | None, renamed("--connect", "--endpoint", "addresses have one name in every command")]
OldPage = Annotated[Path | None, renamed("--page", "--report", "pages have one name in every command")]
OldArm = Annotated[
    str | None, renamed("--arm", "--machine", "it is the name of an arm on the network or in a recording")
]
MachineName = Annotated[
    str | None,
    typer.Option(
        "--machine",
        help="Packaged machine (raven2_left, raven2_right, dvrk_psm), or a robot file (MJCF, URDF), or a model file "
        "(TOML). Its kinematics stands in for poses, or outside joints, that a recording lacks.",
        show_default=False,
    ),
]
Machine = Annotated[
    str | None,
    typer.Option(
        "--machine",
        "--model",
        help="Packaged machine (raven2_left, dvrk_psm, ...), robot file (MJCF, URDF), or model file (TOML).",
        show_default=False,
    ),
]
Report = Annotated[
    Path | None,
    typer.Option("--report", help="Page to write: an .html file, or a folder for report.html.", show_default=False),
]
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
    arm: Arm = None
    tracker_topic: Tracker = None
    tracker_log: TrackerLog = None
    machine: MachineName = None
    as_is: AsIs = False
    drop_disordered: Disordered = False
    old_namespace: OldNamespace = None

    def log(self, paths: list[Path]) -> CalibrationLog:
        """Read the recordings as :func:`read_logs` does; the machine's kinematics adds poses that they lack."""
        from gpcorrect.calibration import with_poses

        return self._read(paths, ("setpoint_cp", "tracker_cp"), with_poses)

    def joint_log(self, paths: list[Path]) -> CalibrationLog:
        """Read recordings of joints; the machine's kinematics adds the true joints that a tracker's poses stand for."""
        from gpcorrect.calibration import with_outside_joints

        learned = ("setpoint_jp", "measured_jp", "external_jp", *(() if self.machine is None else ("tracker_cp",)))
        return self._read(paths, learned, with_outside_joints)

    def _read(
        self, paths: list[Path], learned: Collection[str], completed: Callable[[CalibrationLog, Chain], CalibrationLog]
    ) -> CalibrationLog:
        given = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("machine", "old_namespace")}
        log = read_logs(paths, **given, learned=learned)
        if self.machine is None:
            return log
        whole = completed(log, chain_of(self.machine))
        added = [name for name in whole.signals if name not in log.signals]
        note(f"{' and '.join(added)} computed by the kinematics of {self.machine}" if added else NOTHING_ADDED)
        return whole

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


NOTHING_ADDED = "--machine changes nothing: the recording holds all that its kinematics could add"


def model_named(machine: str) -> Model:
    """Return the packaged machine of a name, or that of a file.

    Parameters
    ----------
    machine : str
        As `--machine` takes it.

    Raises
    ------
    DataError
        There is neither.
    """
    from gpcorrect.sim import preset, preset_names, read_model

    if machine in preset_names():
        return preset(machine)
    if not Path(machine).exists():
        known = f"Packaged machines: {', '.join(preset_names())}."
        raise DataError(f"there is no machine {machine}, packaged or as a file.", hint=known)
    return read_model(machine)


def chain_of(machine: str) -> Chain:
    """Return the kinematics of a machine, from the joints that a recording has of it.

    Parameters
    ----------
    machine : str
        As `--machine` takes it.

    Raises
    ------
    DataError
        There is no such machine, or it has none.
    """
    from gpcorrect.sim import machine_of

    body = machine_of(model_named(machine)).body.compact()
    if body.chain is None or body.chain.dof != len(body.joints):
        raise DataError(
            f"the moving joints of {machine} do not give its poses: "
            + ("it has bare joints." if body.chain is None else "others before or between them are held."),
            hint="Name a machine whose first joints move, as the recording has them.",
        )
    return body.chain


def report_page(report: Path) -> Path:
    """Return the file of a report, after a look whether it can be written.

    Parameters
    ----------
    report : Path
        An .html file, or the folder for report.html.
    """
    if report.suffix.lower() in (".html", ".htm"):
        require_folder(report)
        return report
    make_folder(report)
    return report / "report.html"


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
    tracker_topic, arm : str, optional
        Which tracker and arm of a recording.
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
    chosen: dict[str, Any] = {"tracker_topic": tracker_topic, "disorder": disorder, **arm_chosen(arm)}
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


def arm_chosen(arm: str | None) -> dict[str, Any]:
    """Return the arguments of :func:`gpcorrect.logs.read_log` that choose an arm.

    Parameters
    ----------
    arm : str or None
        Namespace of its topics; left and right are also the two arms of a RAVEN-II's state, and of JIGSAWS.
    """
    return {"namespace": arm, "arm": arm if arm in ("left", "right") else None}


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
