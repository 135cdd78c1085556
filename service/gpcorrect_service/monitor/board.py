"""What is known of every arm at this moment, gathered from its topics and its servers; no network here.

Whoever publishes may publish anything: only what can be shown comes in.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gpcorrect import se3
from gpcorrect.plain import json_ready
from gpcorrect_service.crtk import messages
from gpcorrect_service.monitor.comparison import Comparison, difference, sizes
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.protocol.limits import checked_pose
from gpcorrect_service.protocol.messages import HealthAnswer

LONGEST = 1000  # characters of a text, chosen by hand
JPEG = b"\xff\xd8\xff"  # how one begins
LARGEST = 2**20  # bytes of a picture, chosen by hand: four cameras of ordinary size take a tenth of it


def _require_readable(message: Any) -> None:
    """Refuse a message that cannot be shown or compared."""
    match message:
        case messages.Pose():
            messages.checked_numbers([message.stamp], 1, "the stamp")
            _require_poses(message.pose)
            _require_short(message.frame)
        case messages.Report():
            messages.checked_numbers([message.stamp, message.seconds], 2, "stamp and seconds")
            _require_poses(
                message.desired, message.command, *([] if message.reference is None else [message.reference])
            )
            for what, row in (("std", message.std), ("interval95", message.interval95)):
                if len(row) != 6 or not all(width is None or width >= 0 for width in row):
                    raise bad_input(f"{what} must be 6 numbers from 0 on, got {list(row)}.", "Leave out null.")
            _require_short(message.status, message.reason, message.model_id, message.model_hash)
        case messages.Heartbeat():
            messages.checked_numbers([message.stamp, message.rate], 2, "stamp and rate")
        case messages.OperatingState() | messages.JointState():
            messages.checked_numbers([message.stamp], 1, "the stamp")
        case messages.Text():
            _require_short(message.string)
        case messages.View():
            messages.checked_numbers([message.stamp], 1, "the stamp")
            if not message.jpeg.startswith(JPEG) or len(message.jpeg) > LARGEST:
                raise bad_input(f"a picture is a JPEG of {LARGEST} bytes at most.", "Send a smaller one.")
        case _:
            raise bad_input(f"{type(message).__name__} is not shown.", "Send what docs/crtk.md lists.")


def _require_poses(*poses: tuple[float, ...]) -> None:
    for pose in poses:
        checked_pose(messages.checked_numbers(pose, 7, "a pose (x y z qw qx qy qz)"), math.inf)


def _require_short(*texts: str) -> None:
    if any(len(text) > LONGEST for text in texts):
        raise bad_input(f"a text has more than {LONGEST} characters.", "Send a sentence.")


@dataclass(frozen=True)
class BoardSettings:
    """What is shown for how long; chosen by hand for people who look on."""

    window: float = 60.0  # s of reports that fractions are taken over
    latencies: int = 4096  # reports that latencies are taken over: a minute at 70 Hz
    # s of silence after which a replica is shown as gone, and after which it is not shown
    gone: float = 5.0
    forgotten: float = 60.0
    old: float = 2.0  # s after which what an arm said last is shown as old
    arms: int = 64  # arms that are shown; names beyond it are not taken up


SETTINGS = BoardSettings()


class _Replica(NamedTuple):
    """A server's health, the seconds that it took to come, and when it came."""

    answer: HealthAnswer
    seconds: float
    now: float


class Board:
    """Gathers; safe to write to from zenoh's threads and to read from the page's.

    Parameters
    ----------
    namespace : str, first part of the keys that are watched
    """

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self._arms: dict[str, _ArmView] = {}
        self._lock = threading.Lock()

    def received(self, arm: str, name: str, message: Any, now: float, way: str = "") -> None:
        """Take note of a message on a topic; one that cannot be shown is counted, and changes nothing else.

        Parameters
        ----------
        arm, name : str, of the arm and of the topic
        message : Struct
        now : float, clock of this machine, s
        way : str, by which address it came: what comes by another one while the first goes on, is the same once more
        """
        try:
            _require_readable(message)
        except ServiceError as error:
            self.unreadable(arm, name, error.message)
            return
        with self._lock:
            if (view := self._view(arm)) is not None:
                view.received(name, message, now, way)

    def unreadable(self, arm: str, name: str, cause: str) -> None:
        """Count a message that could not be read.

        Parameters
        ----------
        arm, name, cause : str, of the arm, of the topic, and what is wrong with it
        """
        with self._lock:
            if (view := self._view(arm)) is not None:
                view.unreadable, view.last_unreadable = view.unreadable + 1, f"{name}: {cause}"

    def replica(self, arm: str, answer: HealthAnswer, seconds: float, now: float) -> None:
        """Take note of a server's health.

        Parameters
        ----------
        arm : str
        answer : HealthAnswer
        seconds, now : float, that the answer took; clock of this machine, s
        """
        with self._lock:
            if (view := self._view(arm)) is not None:
                view.replicas[answer.replica] = _Replica(answer, seconds, now)

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return everything, ready for JSON; NaN is None.

        Parameters
        ----------
        now : float, clock of this machine, s
        """
        with self._lock:
            arms = [view.snapshot(now) for _, view in sorted(self._arms.items())]
        shown: dict[str, Any] = json_ready({"namespace": self.namespace, "arms": arms})
        return shown

    def picture(self, arm: str) -> bytes | None:
        """Return what the cameras of an arm showed last, as JPEG; None where they never did.

        Parameters
        ----------
        arm : str
        """
        with self._lock:
            shown: messages.View | None = self._arms[arm].latest.get("view") if arm in self._arms else None
            return None if shown is None else shown.jpeg

    def _view(self, arm: str) -> _ArmView | None:
        """Return an arm's view, a new one for a new name while there is room."""
        if arm not in self._arms and len(self._arms) < SETTINGS.arms:
            self._arms[arm] = _ArmView(arm)
        return self._arms.get(arm)


class _ArmView:
    """One arm."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.replicas: dict[str, _Replica] = {}
        self.unreadable = 0
        self.last_unreadable = ""
        self.latest: dict[str, Any] = {}
        self._at: dict[str, float] = {}
        self._ways: dict[str, str] = {}
        self._received = -math.inf
        self._reports: deque[tuple[float, bool]] = deque()
        self._latencies: deque[float] = deque(maxlen=SETTINGS.latencies)
        self._comparison = Comparison()
        self._refused = 0
        self._error = ""

    def received(self, name: str, message: Any, now: float, way: str) -> None:
        """Take note of a message, as :meth:`Board.received` does."""
        if self._ways.get(name, way) != way and now - self._at[name] <= SETTINGS.old:
            return
        self._ways[name] = way
        self._received = self._at[name] = now
        match message:
            case messages.Report():
                self._reported(message, now)
            case messages.Text():
                self._refused, self._error = self._refused + 1, message.string
            case _:
                self.latest[name] = message
        if name == "tracker_cp":
            self._comparison.tracked(message, now)

    def _reported(self, report: messages.Report, now: float) -> None:
        before = self.latest.get("report")
        if before is not None and before.model_hash != report.model_hash:
            self._comparison = Comparison()
        self._comparison.reported(report, now)
        self.latest["report"] = report
        self._reports.append((now, report.in_domain))
        self._latencies.append(report.seconds)
        self._forget(now)

    def _forget(self, now: float) -> None:
        while self._reports and self._reports[0][0] < now - SETTINGS.window:
            self._reports.popleft()

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return everything of this arm.

        Parameters
        ----------
        now : float
        """
        self._forget(now)
        self.replicas = {k: r for k, r in self.replicas.items() if now - r.now < SETTINGS.forgotten}
        report, state = self.latest.get("report"), self.latest.get("operating_state")
        there = [r.answer for r in self.replicas.values() if now - r.now < SETTINGS.gone]
        # Planners that change between servers of different models make the arm step.
        models = {(answer.model_hash, answer.joint_model_hash) for answer in there}
        return {
            "name": self.name,
            "silent_seconds": now - self._received if math.isfinite(self._received) else None,
            "operating_state": getattr(state, "state", None),
            "state_age": self._age("operating_state", now),
            "is_homed": getattr(state, "is_homed", None),
            "is_busy": getattr(state, "is_busy", None),
            "stamp": getattr(state, "stamp", None),
            "rate_hz": getattr(self.latest.get("heartbeat"), "rate", None),
            "poses": self._poses(report, now),
            "correction": report and {**_correction(report), "age": self._age("corrected/report", now)},
            "error": self._comparison.miss and {**self._comparison.miss, "age": _age(self._comparison.missed_at, now)},
            "outside_share": np.mean([not inside for _, inside in self._reports]).item() if self._reports else None,
            "latency_ms": self._latency_ms(),
            "drift": self._comparison.state(now, self._apart(now)),
            "view": self._age("view", now),
            "unreadable": self.unreadable,
            "last_unreadable": self.last_unreadable,
            "refused": self._refused,
            "last_refusal": self._error,
            "models_differ": len(models) > 1,
            "replicas": [_shown_replica(r, now) for _, r in sorted(self.replicas.items())],
        }

    def _latency_ms(self) -> dict[str, float] | None:
        if not self._latencies:
            return None
        median, high = np.percentile(self._latencies, [50, 99])
        return {"median": 1e3 * float(median), "p99": 1e3 * float(high)}

    def _age(self, name: str, now: float) -> dict[str, Any] | None:
        """Return how long ago a topic last said something, s, and whether that is old; None where it never did."""
        return _age(self._at[name], now) if name in self._at else None

    def _apart(self, now: float) -> float | None:
        """Return by how much tracked poses are stamped later than reports, s; None where not both come."""
        names = ("tracker_cp", "corrected/report")
        if any(now - self._at.get(name, -math.inf) > SETTINGS.old for name in names):
            return None
        return float(self.latest["tracker_cp"].stamp - self.latest["report"].stamp)

    def _poses(self, report: messages.Report | None, now: float) -> dict[str, Any]:
        """Return desired, commanded, measured and tracked pose: mm, degrees, the frame, and the age."""
        desired = report and messages.Pose(report.stamp, report.desired, "tracker")
        named = {
            "desired": (desired or self.latest.get("servo_cp"), "corrected/report" if desired else "servo_cp"),
            "commanded": (self.latest.get("setpoint_cp"), "setpoint_cp"),
            "measured": (self.latest.get("measured_cp"), "measured_cp"),
            "tracked": (self.latest.get("tracker_cp"), "tracker_cp"),
        }
        return {
            k: None if pose is None else {**_shown(pose), "age": self._age(topic, now)}
            for k, (pose, topic) in named.items()
        }


def _age(at: float, now: float) -> dict[str, Any]:
    return {"seconds": now - at, "old": now - at > SETTINGS.old}


def _shown_replica(replica: _Replica, now: float) -> dict[str, Any]:
    answer = replica.answer
    corrections = [c for kind, c in answer.counts.items() if kind.startswith("correct")]
    asked = sum(sum(c.values()) for c in corrections)
    outside = sum(c.get("EXTRAPOLATING", 0) for c in corrections)
    return {
        "replica": answer.replica,
        "state": answer.state if now - replica.now < SETTINGS.gone else "GONE",
        "model_id": answer.model_id,
        "model_hash": answer.model_hash[:12],
        "uptime": answer.uptime,
        "round_trip_ms": 1e3 * replica.seconds,
        "queued": sum(answer.queued.values()),
        "asked": asked,
        "outside_share": outside / asked if asked else None,
        "faults": sum(c.get(status, 0) for c in corrections for status in ("INTERNAL", "STALE", "BUSY")),
    }


def _shown(pose: messages.Pose) -> dict[str, Any]:
    numbers = np.array(pose.pose)
    turn = np.rad2deg(se3.rotvec_from_matrix(se3.matrix_from_quaternion(numbers[None, 3:]))[0])
    return {"mm": 1e3 * numbers[:3], "deg": turn, "frame": pose.frame}


def _correction(report: messages.Report) -> dict[str, Any]:
    """Return how large the correction is beyond registration, how sure, and what was said of it."""
    wide = [math.nan if w is None else w for w in report.interval95]
    size = (
        {"mm": None, "deg": None} if report.reference is None else sizes(difference(report.command, report.reference))
    )
    return {
        **size,
        "interval_mm": 1e3 * np.array(wide[:3]),
        "interval_deg": np.rad2deg(wide[3:]),
        "model_hash": report.model_hash[:12],
        **{name: getattr(report, name) for name in ("in_domain", "status", "reason", "model_id", "stamp")},
    }
