"""Writes down what an arm publishes: a native log, and a ROS 2 recording (MCAP) with CRTK topics."""

from __future__ import annotations

import bisect
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.atomic import require_folder, require_new
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal
from gpcorrect_service.crtk.bus import Bus
from gpcorrect_service.crtk.messages import Event, Message
from gpcorrect_service.crtk.robot import NO_TRAJECTORY
from gpcorrect_service.crtk.ros import to_ros
from gpcorrect_service.protocol.cdr import ros_types

__all__ = ["RECORDED", "Recorder", "Recording", "require_mcap", "write_mcap"]

RECORDED = ("measured_js", "setpoint_js", "external_js", "measured_cp", "setpoint_cp", "tracker_cp", "operating_state")
SIGNALS = {
    "measured_js": {"position": "measured_jp", "velocity": "measured_jv", "effort": "measured_jf"},
    "setpoint_js": {"position": "setpoint_jp"},
    "external_js": {"position": "external_jp"},
}  # of a log, by topic of joints and field; other topics are poses
SAME = 1e-6  # s: stamps this close are one instant


@dataclass(frozen=True, eq=False)
class Recording:
    """Messages by topic, in the order in which they came, and the marks of trajectories.

    Parameters
    ----------
    arm : str
    messages : mapping of topic to messages
    events : tuple of Event
    """

    arm: str
    messages: Mapping[str, tuple[Any, ...]]
    events: tuple[Event, ...]

    def log(self, meta: LogMeta | None = None) -> CalibrationLog:
        """Return the samples at which everything that was recorded has a value, on the arm's clock from 0.

        Samples outside marked trajectories are left out where there are marks.

        Parameters
        ----------
        meta : LogMeta, optional
            Of the log; the arm's name by default.

        Raises
        ------
        LogError
            No joints were recorded, or no instant has them all.
        """
        # Of each topic the messages by stamp, each stamp once.
        topics = {
            name: sorted({m.stamp: m for m in messages}.values(), key=lambda m: m.stamp)
            for name, messages in self.messages.items()
            if messages and name != "operating_state"
        }
        if "measured_js" not in topics:
            raise LogError("nothing was recorded: measured_js is missing.", hint="Is the arm running?")
        clocks = {name: np.array([m.stamp for m in messages]) for name, messages in topics.items()}
        stamps = _common(list(clocks.values()))
        trajectory = self._trajectories(stamps)
        rows = trajectory != NO_TRAJECTORY
        if not rows.any():
            raise LogError("no instant of the recording belongs to a trajectory.", hint="Record for longer.")
        columns: dict[str, Any] = {}
        for name, messages in topics.items():
            chosen = [messages[k] for k in np.searchsorted(clocks[name], stamps[rows] - SAME)]
            if name in SIGNALS:
                columns |= {
                    signal: np.array([getattr(m, field) for m in chosen], dtype=np.float64)
                    for field, signal in SIGNALS[name].items()
                    if getattr(chosen[0], field) is not None
                }
            else:
                pose = np.array([m.pose for m in chosen])
                columns[name] = PoseSignal(pose[:, :3], pose[:, 3:])
        time = stamps[rows] - stamps[0]
        return CalibrationLog(
            time, trajectory[rows], np.zeros(len(time), dtype=np.int64), meta=meta or LogMeta(arm=self.arm), **columns
        )

    def _trajectories(self, stamps: FloatArray) -> Any:
        if not self.events:
            return np.zeros(len(stamps), dtype=np.int64)
        marks = sorted(self.events, key=lambda e: e.stamp)
        begins = [e.stamp for e in marks]
        found = [bisect.bisect_right(begins, s) - 1 for s in stamps]
        return np.array([NO_TRAJECTORY if k < 0 else marks[k].trajectory for k in found], dtype=np.int64)


class Recorder:
    """Listens to one arm from now on.

    Parameters
    ----------
    bus : Bus
    topics : tuple of str
    """

    def __init__(self, bus: Bus, topics: tuple[str, ...] = RECORDED) -> None:
        self._arm = bus.settings.arm
        self._messages: dict[str, list[Message]] = {name: [] for name in topics}
        self._events: list[Event] = []
        self._lock = threading.Lock()
        for name in topics:
            bus.subscribe(name, self._messages[name].append)
        bus.subscribe("event", self._events.append)

    def recording(self) -> Recording:
        """Return what came so far."""
        with self._lock:
            return Recording(self._arm, {k: tuple(v) for k, v in self._messages.items()}, tuple(self._events))


def require_mcap(folder: Path) -> None:
    """Check, before recording, that a ROS 2 recording can be written.

    Parameters
    ----------
    folder : path
        To be made.

    Raises
    ------
    GpCorrectError
        It exists already, the folder above it is not there or may not be written, or rosbags is not installed.
    """
    require_new(folder)
    require_folder(folder)
    ros_types()


def write_mcap(recording: Recording, folder: Path) -> None:
    """Write a ROS 2 recording: a folder with an MCAP file, topics `/arm/measured_js` and so on.

    Parameters
    ----------
    recording : Recording
    folder : path
        Made.

    Raises
    ------
    LogError
        The folder exists already.
    MissingExtraError
        rosbags is not installed.
    """
    store = ros_types()
    from rosbags.rosbag2 import StoragePlugin, Writer

    if folder.exists():
        raise LogError("there is a recording of this name already.", path=str(folder), hint="Name another folder.")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, messages in recording.messages.items():
            if not messages:
                continue
            kind = to_ros(messages[0])[1]
            connection = writer.add_connection(f"/{recording.arm}/{name}", kind, typestore=store)
            for message in messages:
                writer.write(connection, round(message.stamp * 1e9), store.serialize_cdr(to_ros(message)[0], kind))


def _common(stamps: list[FloatArray]) -> FloatArray:
    """Return the instants that every topic has."""
    common = stamps[0]
    for other in stamps[1:]:
        near = np.clip(np.searchsorted(other, common - SAME), 0, len(other) - 1)
        common = common[np.abs(other[near] - common) <= SAME]
    if not len(common):
        raise LogError("no two topics have a stamp in common.", hint="Record topics of one arm.")
    return common
