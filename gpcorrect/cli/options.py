"""Options that several commands share, declared once so that they read alike everywhere."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from gpcorrect.atomic import make_folder, require_own
from gpcorrect.errors import DataError

if TYPE_CHECKING:
    from gpcorrect_service.crtk import BusSettings
    from gpcorrect_service.protocol.settings import RosDistro


def renamed(old: str, new: str, why: str) -> Any:
    """Return the hidden option that refuses a name which an option had, and says the new one.

    Parameters
    ----------
    old, new : str, names of the option, with their dashes
    why : str, what the old name means elsewhere
    """

    def _refuse(value: Any) -> None:
        if value:
            raise DataError(f"{old} is not taken here: {why}.", hint=f"Give {new} instead of {old}.")

    return typer.Option(old, hidden=True, callback=_refuse)


# Recordings and models.
Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Recordings: CSV, Parquet, NPY, MATLAB, HDF5, ROS 1 or 2 bags, C3D, TRC, Motive, Vicon, Qualisys, NDI."
    ),
]
Columns = Annotated[
    Path | None, typer.Option(help="Mapping file (TOML) for a foreign table or a bag: which column is what.")
]
Tracker = Annotated[str | None, typer.Option(help="Topic of the outside tracker in a bag.")]
TrackerLog = Annotated[
    Path | None,
    typer.Option(
        help="Recording of the outside tracker on a clock of its own: a Motive, Vicon, Qualisys, NDI, TRC or C3D file."
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
    ),
]
Machine = Annotated[
    str | None,
    typer.Option(
        "--machine",
        "--model",
        help="Packaged machine (raven2_left, dvrk_psm, ...), robot file (MJCF, URDF), or model file (TOML).",
    ),
]
Report = Annotated[
    Path | None, typer.Option("--report", help="Page to write: an .html file, or a folder for report.html.")
]
AsIs = Annotated[bool, typer.Option("--as-is", help="Take recordings whose units or frames look wrong as they are.")]
Disordered = Annotated[
    bool, typer.Option("--drop-disordered", help="Leave out samples whose time does not increase, and say how many.")
]
Clock = Annotated[
    str,
    typer.Option(
        help="Tracker's clock: auto (shift what cannot be robot lag), motion (shift by all that the motion says, drift "
        "included), none, or seconds it runs ahead."
    ),
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
ModelFile = Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.")]
AnyModel = Annotated[Path, typer.Argument(help="Model file that a fit wrote.")]
ModelOutput = Annotated[Path, typer.Option("--output", "-o", help="Model file to write.")]
LogOutput = Annotated[Path, typer.Option("--output", "-o", help="Log to write: CSV or Parquet by its ending.")]

# What a command prints, and where its work is done.
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
AlwaysJson = Annotated[
    bool, typer.Option("--json", help="Taken, and needless: JSON is printed in any case.", show_default=False)
]
Jobs = Annotated[int, typer.Option(help="Processes of this machine to spread the work over; -1 for one a core.")]
Scheduler = Annotated[str | None, typer.Option(help="Dask scheduler to spread the work over, such as tcp://head:8786.")]

# Motion of the first three joints.
Limits = Annotated[str, typer.Option(help="LOW:HIGH of joints 1, 2 (deg) and 3 (mm).")]
Speed = Annotated[str, typer.Option(help="Speed limits of joints 1, 2 (deg/s) and 3 (mm/s).")]
BLOCK, FASTEST = "20:60,55:110,330:420", "5,5,20"  # inside the limits of the left RAVEN-II; an arm that is quasi-static

# Robots and services on the network.
ROBOT, SERVICE = "tcp/127.0.0.1:7448", "tcp/127.0.0.1:7449"  # 7447 is zenoh's own, and that of ROS 2's router
Endpoint = Annotated[str, typer.Option(help="Address of the robot or service.")]
ArmName = Annotated[str, typer.Option(help="CRTK name of the arm: the second part of every key.")]
KeyRoot = Annotated[str, typer.Option(help="First part of every key.")]
Config = Annotated[Path | None, typer.Option(help="zenoh configuration (JSON5) instead of --endpoint.")]
Listen = Annotated[str, typer.Option(help="Address to listen on.")]
Remote = Annotated[bool, typer.Option("--allow-remote", help="Listen on an address that other machines can reach.")]
RosDomain = Annotated[int | None, typer.Option(help="Speak on rmw_zenoh's keys too, in this ROS_DOMAIN_ID.")]
RosName = Annotated[
    str | None,
    typer.Option(
        "--ros-distro", help="ROS distribution of the nodes there: humble, jazzy or rolling; jazzy without it."
    ),
]


@dataclass(frozen=True)
class RobotPlace:
    """Where a robot is on the network; its fields become options of the command."""

    endpoint: Endpoint = ROBOT
    arm: ArmName = "arm1"
    namespace: KeyRoot = "gpcorrect"
    config: Config = None

    @property
    def bus(self) -> BusSettings:
        """The same as settings of a client."""
        from gpcorrect_service.crtk import BusSettings  # zenoh is an extra; other commands work without it

        return BusSettings(self.endpoint, self.arm, self.namespace, config_file=self.config)


@dataclass(frozen=True)
class ServicePlace(RobotPlace):
    """Where a service is on the network."""

    endpoint: Endpoint = SERVICE


def report_page(report: Path | None, model: Path | None = None, *, rejected: bool = False) -> Path | None:
    """Return the file of a report, after a look whether it can be written; None where none is asked for.

    Parameters
    ----------
    report : Path or None, an .html file, or the folder for report.html
    model : Path, optional, file of the model that the same command writes: the page must be another
    rejected : bool, whether the samples that were rejected are written beside it, see :func:`rejected_table`
    """
    if report is None:
        return None
    page = report
    if report.suffix.lower() not in (".html", ".htm"):
        make_folder(report)
        page = report / "report.html"
    beside = [rejected_table(page)] if rejected else []
    if model is not None and model.resolve() in (page.resolve(), *(table.resolve() for table in beside)):
        raise DataError(f"the model and the report would both be {model}.", hint="Name another --output or --report.")
    require_own(page, rb"(?i)\s*<!doctype html", "page")
    for table in beside:
        require_own(table, rb"set\b", "list of rejected samples")
    return page


def rejected_table(page: Path) -> Path:
    """Return the file beside a page that lists the samples which cleaning rejected.

    Parameters
    ----------
    page : Path
    """
    return page.with_name("cleaning.csv" if page.name == "report.html" else f"{page.stem}-cleaning.csv")


def takes_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for every field of each parameter that is a dataclass of options, as `Reading` is.

    The program does that to each of its commands.

    Parameters
    ----------
    command : callable
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    if not groups:
        return command
    keywords = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name in groups:
            types = get_type_hints(groups[name], include_extras=True)
            options = [(f.name, f.default, types[f.name]) for f in fields(groups[name])]
        else:
            options = [(name, parameter.default, hints[name])]
        keywords += [
            inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for n, default, annotation in options
        ]

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        made = {n: group(**{f.name: values.pop(f.name) for f in fields(group)}) for n, group in groups.items()}
        command(**made, **values)

    wrapped.__annotations__ = {p.name: p.annotation for p in keywords} | {"return": None}
    wrapped.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]  # what inspect looks for
    return wrapped


def numbers(text: str, separator: str, count: int, what: str) -> list[float]:
    """Return the numbers of a text; DataError where there are more or fewer, or they are none.

    Parameters
    ----------
    text, separator : str, the text, and what stands between two numbers
    count : int
    what : str, what they are, for the message
    """
    try:
        found = [float(part) for part in text.split(separator)]
    except ValueError as error:
        raise DataError(f"{what} must be numbers, got {text!r}.") from error
    if len(found) != count:
        raise DataError(f"{what} need {count} numbers separated by {separator!r}, got {text!r}.")
    return found


def one_of(chosen: str | None, choices: tuple[Any, ...], what: str) -> Any:
    """Return the choice that was given by its name; DataError where there is none of this name.

    Parameters
    ----------
    chosen : str or None
    choices : tuple
    what : str, begins the message, such as "the marker"
    """
    for choice in choices:
        if chosen == choice:
            return choice
    names = [str(choice) for choice in choices if choice is not None]
    raise DataError(f"{what} is {', '.join(names[:-1])} or {names[-1]}; got {chosen!r}.")


def ros_distro_of(chosen: str | None, domain: int | None) -> RosDistro:
    """Return the ROS distribution that was named, or the usual; DataError for no such name, or no domain for it.

    Parameters
    ----------
    chosen : str or None
    domain : int or None, ROS_DOMAIN_ID, where one was given
    """
    from gpcorrect_service.protocol.settings import RosDistro

    if chosen is not None and domain is None:
        raise DataError("--ros-distro says how to speak with ROS, and nothing says where.", hint="Add --ros-domain 0")
    distro: RosDistro = one_of(chosen or "jazzy", get_args(RosDistro), "the ROS distribution")
    return distro
