"""Writes down what an arm publishes: a journal while it comes, a native log, and a ROS 2 recording (MCAP)."""

from __future__ import annotations

import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from gpcorrect.atomic import require_folder, require_new
from gpcorrect.errors import LogError
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal
from gpcorrect_service.crtk.bus import Bus
from gpcorrect_service.crtk.messages import TOPICS, Message, to_cdr
from gpcorrect_service.crtk.robot import NO_TRAJECTORY
from gpcorrect_service.protocol.ros import ros_types

BEGINS = b"gpcorrect recording 1\n"  # first line of a journal, with the number of its form
LENGTH = struct.Struct("<I")
LONGEST = 1 << 16  # bytes of an entry: a hundred joints have a tenth of it
SUFFIX = ".unfinished"  # behind the name of the recording to come
RECORDED = ("measured_js", "setpoint_js", "external_js", "measured_cp", "setpoint_cp", "tracker_cp", "operating_state")
SIGNALS = {
    "measured_js": {"position": "measured_jp", "velocity": "measured_jv", "effort": "measured_jf"},
    "setpoint_js": {"position": "setpoint_jp"},
    "external_js": {"position": "external_jp"},
}  # of a log, by topic of joints and field; other topics are poses
CLOCK_STEP = 0.5  # chosen by hand: s that stamps of the joints may run back; more is a clock that was set
APART = 1e7  # s between what came before and after such a step, on one axis: longer than any recording
PAUSE = 1.0  # chosen by hand: s between them in the log, more than between samples
MOSTLY = 0.5  # chosen by hand: of the samples, at which a signal must have a value for those without it to be left out


class _Entry(msgspec.Struct, array_like=True):
    """A message as it came: its topic, and how often the robot's clock had been set back."""

    topic: str
    epoch: int
    message: msgspec.Raw


class Journal(AbstractContextManager["Journal"]):
    """Writes messages beside a recording to come, until it is removed because the recording is written.

    A killed process leaves all but its last few dozen messages, a power cut all but the last half minute.

    Parameters
    ----------
    recording : Path
        The file to come; the journal has its name and `.unfinished` behind it, and is never written over another.
    arm : str

    Attributes
    ----------
    path : Path
    failed : OSError or None
        Why messages are not written any more: the disk is full. The recorder goes on without.
    """

    def __init__(self, recording: Path, arm: str) -> None:
        self.path = _journal_of(recording)
        self.failed: OSError | None = None
        self._lock = threading.Lock()
        self._file = self.path.open("xb")
        self._file.write(BEGINS + arm.encode() + b"\n")

    def __exit__(self, *_: object) -> None:
        with self._lock:
            try:
                self._file.close()
            except OSError as full:
                self.failed = self.failed or full

    def remove(self) -> None:
        """Remove the file: the recording is written."""
        self.path.unlink(missing_ok=True)

    def write(self, topic: str, epoch: int, message: Message) -> None:
        """Write a message.

        Parameters
        ----------
        topic : str
        epoch : int, how often the robot's clock had been set back when it came
        message : Struct
        """
        entry = msgspec.msgpack.encode(_Entry(topic, epoch, msgspec.Raw(msgspec.msgpack.encode(message))))
        with self._lock:
            # No arm's message is so long, and who reads the journal would take its end for lost.
            if self.failed is not None or self._file.closed or len(entry) > LONGEST:
                return
            try:
                self._file.write(LENGTH.pack(len(entry)) + entry)
            except OSError as error:
                self.failed = error


def _journal_of(recording: Path) -> Path:
    """Return the name of a recording's journal."""
    return recording.with_name(recording.name + SUFFIX)


def require_no_journal(recording: Path) -> None:
    """Check, before recording, that a journal can be written and that no earlier one would be lost.

    Parameters
    ----------
    recording : path, GpCorrectError where its folder may not be written, or a recording of this name was broken off
    """
    path = _journal_of(recording)
    if path.exists():
        cause = "a recording of this name was broken off, and this is what came until then."
        raise LogError(cause, path=str(path), hint=f"Read it: gpcorrect robot recover {path} --output LOG")
    require_new(recording)
    require_folder(path)


def _entries(path: Path, rest: memoryview) -> Iterator[tuple[str, int, Any]]:
    """Give topic, epoch and message in the order in which they came; a torn end is left out."""
    read = msgspec.msgpack.Decoder(_Entry)
    while len(rest) >= LENGTH.size:
        (length,) = LENGTH.unpack(rest[: LENGTH.size])
        if length > LONGEST:  # no torn end, behind which nothing would be lost
            raise _altered(path, f"an entry of {length} bytes")
        body, rest = rest[LENGTH.size : LENGTH.size + length], rest[LENGTH.size + length :]
        if len(body) < length:
            return
        try:
            entry = read.decode(body)
            yield entry.topic, entry.epoch, msgspec.msgpack.decode(entry.message, type=TOPICS[entry.topic].form)
        except (msgspec.MsgspecError, ValueError, KeyError) as error:
            raise _altered(path, str(error)) from error


def _altered(path: Path, why: str) -> LogError:
    return LogError(f"it was altered ({why}).", path=str(path), hint="Copy it again.")


class Came(NamedTuple):
    """A message, and how often the robot's clock had been set back when it came."""

    epoch: int
    message: Any


@dataclass(frozen=True, eq=False)
class Recording:
    """Messages by topic, in the order in which they came, the marks of trajectories, and what was left out."""

    arm: str
    messages: Mapping[str, tuple[Came, ...]]  # those of a topic hold as many numbers each
    events: tuple[Came, ...]
    remarks: tuple[str, ...] = ()

    def log(self, meta: LogMeta | None = None) -> CalibrationLog:
        """Return the samples of the joints, from 0 on the arm's clock, with what else was recorded at those times.

        Samples outside marked trajectories are left out where there are marks, and those at which a signal that
        mostly has a value has none. Where the robot's clock was set back a new session begins.

        Parameters
        ----------
        meta : LogMeta, optional, of the log; the arm's name by default

        Raises
        ------
        LogError
            No joints were recorded, or none inside a trajectory.
        """
        joints = self.messages.get("measured_js", ())
        if not joints:
            raise LogError("nothing was recorded: measured_js is missing.", hint="Is the arm running?")
        origins: dict[int, float] = {}
        for epoch, message in joints:
            origins.setdefault(epoch, message.stamp)

        def axis(came: Sequence[Came]) -> FloatArray:
            return np.array([c.message.stamp - origins.get(c.epoch, np.inf) + c.epoch * APART for c in came])

        at = np.unique(axis(joints))
        session = np.round(at / APART).astype(np.int64)
        trajectory = self._trajectories(at, axis(self.events))
        remarks, keep = list(self.remarks), trajectory != NO_TRAJECTORY
        columns: dict[str, Any] = {}
        for stream in self._streams(axis):
            values = interpolate(stream, at)
            table = values.position if isinstance(values, PoseSignal) else values
            there = np.isfinite(table).any(axis=1)
            if there.mean() >= MOSTLY:
                keep &= there
            elif there.any():
                remarks.append(f"{stream.name} has a value at {there.sum()} of {len(at)} samples.")
            else:
                remarks.append(f"{stream.name} shares no time with measured_js and is left out.")
                continue
            columns[stream.name] = values
        if not keep.any():
            raise LogError("no instant of the recording belongs to a trajectory.", hint="Record for longer.")
        if session.any():
            remarks.append("the robot's clock was set back while it was recorded: a new session begins there.")
            trajectory = trajectory + session * (trajectory.max() + 1)
        return CalibrationLog(
            _time(at, session)[keep],
            trajectory[keep],
            session[keep],
            meta=meta or LogMeta(arm=self.arm),
            remarks=tuple(remarks),
            **{name: values[keep] for name, values in columns.items()},
        )

    def _streams(self, axis: Callable[[Sequence[Came]], FloatArray]) -> Iterator[Stream]:
        """Give the signals of a log, each on its own stamps."""
        for name, came in self.messages.items():
            if not came or name == "operating_state":
                continue
            stamp, messages = axis(came), [c.message for c in came]
            if name not in SIGNALS:
                yield Stream(name, stamp, PoseSignal.of(np.array([m.pose for m in messages])))
                continue
            missing = (None,) * len(messages[0].position)
            for field, signal in SIGNALS[name].items():
                rows = [getattr(m, field) or () for m in messages]
                if any(len(row) == len(missing) for row in rows):
                    filled = [row if len(row) == len(missing) else missing for row in rows]
                    yield Stream(signal, stamp, np.array(filled, dtype=np.float64))

    def _trajectories(self, at: FloatArray, marked: FloatArray) -> Any:
        if not self.events:
            return np.zeros(len(at), dtype=np.int64)
        order = np.argsort(marked, kind="stable")
        numbers = np.array([NO_TRAJECTORY, *(self.events[k].message.trajectory for k in order)], dtype=np.int64)
        return numbers[np.searchsorted(marked[order], at, side="right")]


class Recorder:
    """Listens to topics of one arm from now on, and writes every message into a journal, if given, as it comes."""

    def __init__(self, bus: Bus, topics: tuple[str, ...] = RECORDED, journal: Journal | None = None) -> None:
        self._arm, self._journal = bus.settings.arm, journal
        self._came: dict[str, list[Came]] = {name: [] for name in (*topics, "event")}
        self._epoch, self._newest = 0, -np.inf
        for name in self._came:
            bus.subscribe(name, partial(self._keep, name))

    def _keep(self, name: str, message: Any) -> None:
        if not message.stamp:  # says no time
            return
        if name == "measured_js":
            self._epoch += message.stamp < self._newest - CLOCK_STEP
            self._newest = message.stamp
        self._came[name].append(Came(self._epoch, message))
        if self._journal is not None:
            self._journal.write(name, self._epoch, message)

    def recording(self) -> Recording:
        """Return what came so far; of a topic's messages those that hold as many numbers as most of them."""
        return _recording(self._arm, {name: tuple(came) for name, came in self._came.items()})


def recovered(path: Path) -> Recording:
    """Return the recording of a recorder that was killed.

    Parameters
    ----------
    path : path, its journal; LogError where there is no such file, or it is none, or was altered
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"it cannot be read ({error.strerror}).", path=str(path)) from error
    arm, _, rest = content.removeprefix(BEGINS).partition(b"\n")
    if not content.startswith(BEGINS):
        raise LogError("it is not what a recorder leaves.", path=str(path), hint=f"Its name ends in {SUFFIX}.")
    came: dict[str, list[Came]] = {"event": []}
    for name, epoch, message in _entries(path, memoryview(rest)):
        came.setdefault(name, []).append(Came(epoch, message))
    return _recording(arm.decode(errors="replace"), came)


def _recording(arm: str, came: Mapping[str, Sequence[Came]]) -> Recording:
    remarks, whole = [], {}
    for name, all_of_it in came.items():
        widths = Counter(_width(c.message) for c in all_of_it)
        usual = widths.most_common(1)[0][0] if widths else 0
        whole[name] = tuple(c for c in all_of_it if _width(c.message) == usual)
        if len(whole[name]) < len(all_of_it):
            odd = f"{len(all_of_it) - len(whole[name])} messages of {name} do not hold as many numbers as the others"
            remarks.append(f"{odd} and are left out.")
    events = whole.pop("event")
    return Recording(arm, whole, events, tuple(remarks))


def _width(message: Any) -> int:
    numbers = getattr(message, "position", None) or getattr(message, "pose", None) or ()
    return len(numbers)


def _time(at: FloatArray, session: IntArray) -> FloatArray:
    """Return times from 0, those of each session after those of the one before."""
    time, begin = np.empty_like(at), 0.0
    for number in np.unique(session):
        rows = session == number
        time[rows] = at[rows] - at[rows][0] + begin
        begin = time[rows][-1] + PAUSE
    return time


def require_mcap(folder: Path) -> None:
    """Check, before recording, that a ROS 2 recording can be written: name, folder, and rosbags.

    Parameters
    ----------
    folder : path
    """
    require_new(folder)
    require_folder(folder)
    ros_types()


def write_mcap(recording: Recording, folder: Path) -> None:
    """Write a ROS 2 recording: a folder with an MCAP file, topics `/arm/measured_js` and so on.

    Parameters
    ----------
    recording : Recording
    folder : path, made; LogError where it exists already
    """
    store = ros_types()
    from rosbags.rosbag2 import StoragePlugin, Writer

    if folder.exists():
        raise LogError("there is a recording of this name already.", path=str(folder), hint="Name another folder.")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, messages in recording.messages.items():
            if not messages:
                continue
            kind = TOPICS[name].ros_type
            connection = writer.add_connection(f"/{recording.arm}/{name}", kind, typestore=store)
            for _, message in messages:
                writer.write(connection, round(message.stamp * 1e9), to_cdr(message))
