"""How commands read recordings: the options, and what a machine's kinematics adds."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpcorrect.cli.console import note
from gpcorrect.cli.options import Arm, AsIs, Clock, Columns, Disordered, MachineName, OldNamespace, Tracker, TrackerLog
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from gpcorrect.arms import Chain
    from gpcorrect.logs.order import Disorder
    from gpcorrect.sim import Model

MOTION = "motion"  # of --time-offset: what the motion says is the sensors' clock


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
        chain = None if self.machine is None else chain_of(self.machine)
        log = read_logs(paths, **given, learned=learned, chain=chain)
        if chain is None:
            return log
        whole = completed(log, chain)
        added = [name for name in whole.signals if name not in log.signals]
        if added:
            note(f"{' and '.join(added)} computed by the kinematics of {self.machine}")
        else:
            note("--machine changes nothing: the recording holds all that its kinematics could add")
        return whole

    @property
    def clock_left(self) -> str:
        """What is left to do about the tracker's clock after a tracker's recording was put beside the robot's."""
        done = self.time_offset == MOTION or (self.tracker_log is not None and self.time_offset != "auto")
        return "none" if done else self.time_offset


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
    chain: Chain | None = None,
) -> CalibrationLog:
    """Read the recordings and join them into one log, a session each; put another one's tracker beside the only one.

    Parameters
    ----------
    paths, columns : list of Path, and Path or None
        Recordings, and their mapping file.
    as_is, drop_disordered : bool
        Take what looks misread (None where the command has no such option); leave out samples whose time does not
        increase.
    tracker_topic, arm : str, optional, which tracker and arm of a recording
    tracker_log, time_offset : Path or None, and str
        The tracker's own recording; "auto", "motion", "none", or the seconds that its clock runs ahead.
    learned : collection of str, signals that the command learns from or measures
    chain : Chain, optional
        The arm's: a tracker is compared with the poses that the joints stand for, where a recording has joints only.

    Raises
    ------
    LogError
        One of them cannot be read, or cannot be in the units and frames it is taken for, unless taken `as_is`; or the
        tracker's recording does not go with the robot's; or one was given twice.
    """
    from gpcorrect.calibration import with_poses
    from gpcorrect.logs import join_logs, read_log, refuse_misread, with_tracker
    from gpcorrect.logs.sync import shifted_by_motion

    disorder: Disorder = "drop" if drop_disordered else "refuse"
    chosen: dict[str, Any] = {"tracker_topic": tracker_topic, "disorder": disorder, **arm_chosen(arm)}
    columns, columns_beside = (columns, columns) if tracker_log is None else mappings(columns)
    logs = [read_log(path, columns=columns, **chosen) for path in paths]
    if tracker_log is not None:
        if len(logs) > 1:
            raise LogError("--tracker-log goes with one recording of the robot.", hint="Give them one at a time.")
        take = read_log(tracker_log, columns=columns_beside, disorder=disorder)
        logs = [with_tracker(logs[0], take, seconds_ahead(time_offset))]
    elif time_offset == MOTION:
        logs = [shifted_by_motion(log) for log in logs]
    for log in logs:
        looked_at = log if chain is None else with_poses(log, chain)
        try:
            for found in refuse_misread(looked_at, learned, as_is=bool(as_is)):
                note(f"{log.name}: {f'{found.signal}: ' if found.signal else ''}{found.message}")
        except LogError as error:  # name the way past the refusal too
            past = "" if as_is is None else " If you know better: --as-is"
            hint = f"{error.hint} More: gpcorrect validate LOG.{past}"
            raise LogError(error.message, hint=hint) from error
    return logs[0] if len(logs) == 1 else join_logs(logs)


def mappings(columns: Path | None) -> tuple[Path | None, Path | None]:
    """Return the mapping file of a robot's recording, and that of its tracker's: each where signals of it are named.

    Parameters
    ----------
    columns : Path or None, the mapping file that was given for both
    """
    from gpcorrect.logs.columns import load_columns

    named = set() if columns is None else load_columns(columns).model_fields_set
    tracker = "tracker_cp" in named
    robot = bool(
        named & {*CalibrationLog.POSES, *CalibrationLog.JOINTS, *CalibrationLog.SCALARS, "bag"} - {"tracker_cp"}
    )
    return columns if robot or not tracker else None, columns if tracker or "mocap" in named or not robot else None


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
    time_offset : str, "auto", "motion", "none", or seconds
    """
    from gpcorrect.logs.sync import seconds_of

    known = {"auto": None, MOTION: None, "none": 0.0}
    return known[time_offset] if time_offset in known else seconds_of(time_offset)


def refuse_unused_clock(time_offset: str, tracker_log: Path | None) -> None:
    """Refuse seconds of a tracker's clock where a command shifts nothing but a tracker's recording of its own.

    Parameters
    ----------
    time_offset, tracker_log : str, and Path or None, as the command was given them
    """
    if tracker_log is None and time_offset not in ("auto", MOTION, "none"):
        hint = "Give --tracker-log, or leave it out here and give it to `gpcorrect fit` and `evaluate`."
        raise DataError(f"--time-offset {time_offset} goes with --tracker-log, which was not given.", hint=hint)


def model_named(machine: str) -> Model:
    """Return the packaged machine of a name, or that of a file; DataError where there is neither.

    Parameters
    ----------
    machine : str, as `--machine` takes it
    """
    from gpcorrect.sim import preset, preset_names, read_model

    if machine in preset_names():
        return preset(machine)
    if not Path(machine).exists():
        known = f"Packaged machines: {', '.join(preset_names())}."
        raise DataError(f"there is no machine {machine}, packaged or as a file.", hint=known)
    return read_model(machine)


def chain_of(machine: str) -> Chain:
    """Return the kinematics of a machine, from the joints that a recording has of it; DataError where it has none.

    Parameters
    ----------
    machine : str, as `--machine` takes it
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
