"""Several recordings as one: one after the other, or the robot's and the motion capture's on a clock of its own."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import combinations
from typing import Any, Literal, cast

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.copies import LEAST, marks_of
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.sync import REFERENCES, TimeOffset, stream_offset
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal

SAME_MACHINE = ("robot", "arm", "joint_types")

IN_BOTH = 0.05  # of the stretches of the shorter of two recordings, from which they hold the same samples
SAME_MOTION = 0.9  # of the spread that one motion must explain of the other
IN_COMMON = 0.5  # of the shorter recording: both are of one session

# For recordings whose motion does not say how their clocks lie.
_HINT = "Give the seconds by which the tracker's clock runs ahead: --time-offset SECONDS."


def join_logs(logs: Sequence[CalibrationLog], *, sessions: Literal["renumber", "keep"] = "renumber") -> CalibrationLog:
    """One log of all rows, in the order given, in which no trajectory runs from one log into the next.

    Trajectories are numbered anew from zero. A signal that some log lacks is dropped; the remarks say so.

    Parameters
    ----------
    logs : sequence of CalibrationLog, at least one
    sessions : {"renumber", "keep"}
        Number sessions anew, each log its own; or keep the numbers, when they mean the same in every log.

    Raises
    ------
    LogError
        There is no log, the same recording comes twice, static poses are among recordings, or the logs are of different
        robots, arms, or names or numbers of joints.
    """
    if not logs:
        raise LogError("expected at least one log, got none.")
    if len(logs) == 1:
        return logs[0]
    if len({log.static for log in logs}) > 1:
        raise LogError("static poses cannot be joined with recordings that have a clock.")
    names = max((log.meta.joint_names for log in logs), key=len)
    logs = [in_joint_order(log, names) for log in logs]
    refuse_twice(logs)
    digest = hashlib.sha256("".join(log.digest for log in logs).encode()).hexdigest()
    common = tuple(s for s in logs[0].signals if all(s in log.signals for log in logs))
    signals: dict[str, Any] = {name: _joined(logs, name) for name in common}
    extra = [name for name in logs[0].extra if all(name in log.extra for log in logs)]
    numbers = _renumbered([log.session for log in logs])
    return CalibrationLog(
        np.concatenate([log.time for log in logs]),
        _renumbered([log.trajectory for log in logs]),
        numbers if sessions == "renumber" else np.concatenate([log.session for log in logs]),
        **signals,
        extra={name: np.concatenate([log.extra[name] for log in logs]) for name in extra},
        meta=replace(_joined_meta(logs), joint_names=names),
        static=logs[0].static,
        name=", ".join(log.name for log in logs),
        recordings=tuple(recording for log in logs for recording in log.recordings),
        contents=tuple(content for log in logs for content in log.contents),
        digest=digest if all(log.digest for log in logs) else "",
        remarks=(*_remarks(logs, common), *(f"{log.name}: {r}" for log in logs for r in log.remarks)),
        listed_joints=next((log.listed_joints for log in logs if log.listed_joints), ()),
    )


def in_joint_order(log: CalibrationLog, names: Sequence[str]) -> CalibrationLog:
    """Return a log with its joints in the order of these names, and a remark; as it is where it or they name none.

    Parameters
    ----------
    log : CalibrationLog
    names : sequence of str, of all joints in the order wanted; more or fewer only behind those that both name

    Raises
    ------
    LogError
        The log names other joints, or lacks columns of some.
    """
    own, names = log.meta.joint_names, tuple(names)
    both = min(len(own), len(names))
    if own[:both] == names[:both]:
        return log
    said = f"the joints are {', '.join(own)}, and those that they go with {', '.join(names)}"
    if sorted(own) != sorted(names):
        hint = "If they are the same joints, name them alike in the sidecar: joint_names."
        raise LogError(f"{said}.", hint=hint, path=log.name)

    def places(width: int) -> list[int]:
        order = [*(own.index(name) for name in names[:width]), *range(len(own), width)]
        if max(order, default=-1) >= width:
            raise LogError(f"{said}: {width} columns cannot be put in that order.", path=log.name)
        return order

    tables = {name: getattr(log, name) for name in log.JOINTS if name in log.signals}
    moved: dict[str, Any] = {name: table[:, places(table.shape[1])] for name, table in tables.items()}
    types = "".join(log.meta.joint_types[k] for k in places(len(log.meta.joint_types)))
    meta = replace(log.meta, joint_names=names, joint_types=types)
    ordered = replace(log, **moved, meta=meta, listed_joints=own)
    return replace(ordered, remarks=(*log.remarks, order_words(ordered)))


def order_words(log: CalibrationLog) -> str:
    """Say in which order joints came, and were put; nothing of a log whose joints stand as they came.

    Parameters
    ----------
    log : CalibrationLog
    """
    came, put = ", ".join(log.listed_joints), ", ".join(log.meta.joint_names)
    return f"the columns of joints were put by name in the order {put}; they came as {came}." if came else ""


def refuse_twice(logs: Sequence[CalibrationLog]) -> None:
    """Refuse recordings that hold the same samples: copies would count as if they were new.

    Parameters
    ----------
    logs : sequence of CalibrationLog

    Raises
    ------
    LogError
        With the first two that do.
    """
    first: dict[str, str] = {}
    for log in logs:
        for digest in (*log.recordings, *log.contents):
            if digest in first:
                raise LogError(
                    f"{log.name} is the same recording as {first[digest]}: its second copy would count as if it were "
                    "new.",
                    hint="Give each recording once.",
                )
            first[digest] = log.name
    marks = [marks_of(log) for log in logs]
    for (one, some), (other, others) in combinations(zip(logs, marks, strict=True), 2):
        count = len(np.intersect1d(some, others, assume_unique=True))
        if count >= max(LEAST, IN_BOTH * min(len(some), len(others))):
            raise LogError(
                f"{other.name} holds samples that {one.name} holds too ({count} stretches of its outside sensor): "
                "they would count as if they were new.",
                hint="Give each motion once.",
            )


def _renumbered(numbers: Sequence[IntArray]) -> IntArray:
    """Numbers from zero, by first appearance, that no two logs share."""
    keys = np.concatenate([np.column_stack([np.full(len(part), k), part]) for k, part in enumerate(numbers)])
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[place.reshape(-1)]


def _joined(logs: Sequence[CalibrationLog], name: str) -> Any:
    values = [getattr(log, name) for log in logs]
    if not isinstance(values[0], PoseSignal):
        widths = {v.shape[1:] for v in values}
        if len(widths) > 1:
            found = ", ".join(f"{log.name}: {v.shape[1]}" for log, v in zip(logs, values, strict=True))
            raise LogError(f"the logs have different numbers of joints in {name} ({found}).")
        return np.concatenate(values)
    quaternions = [v.quaternion for v in values]
    turned = None if any(q is None for q in quaternions) else np.concatenate(quaternions)
    return PoseSignal(np.concatenate([v.position for v in values]), turned)


def _joined_meta(logs: Sequence[CalibrationLog]) -> LogMeta:
    """Join what the logs say: the same once, different notes one after the other."""
    merged: dict[str, Any] = {}
    for name in (f.name for f in fields(LogMeta) if f.name not in ("tracker_base", "joint_names")):
        values = list(dict.fromkeys(v for log in logs if (v := getattr(log.meta, name))))
        if name in SAME_MACHINE and len(values) > 1:
            raise LogError(f"logs of different machines cannot be joined: {name} is {' and '.join(values)}.")
        merged[name] = "; ".join(values)
    frames = {log.meta.tracker_base for log in logs}
    return LogMeta(**merged, tracker_base=frames.pop() if len(frames) == 1 else None)


def _remarks(logs: Sequence[CalibrationLog], common: tuple[str, ...]) -> list[str]:
    dropped = sorted({s for log in logs for s in log.signals} - set(common))
    remarks = [f"signals that not every log has were dropped: {', '.join(dropped)}."] if dropped else []
    for name in (s for s in common if s in CalibrationLog.POSES):
        turned = [getattr(log, name).quaternion is not None for log in logs]
        if any(turned) and not all(turned):
            remarks.append(f"{name} has no orientation in every log; its positions only were taken.")
    if len({log.meta.tracker_base for log in logs}) > 1:
        remarks.append("the logs state different frames of the tracker; none was taken.")
    return remarks


def with_tracker(robot: CalibrationLog, take: CalibrationLog, ahead: float | None = None) -> CalibrationLog:
    """Put the tracker of another recording on the robot's clock and rows.

    Parameters
    ----------
    robot : CalibrationLog, without a tracker; its clock runs through all trajectories
    take : CalibrationLog, with `tracker_cp`
    ahead : float, optional
        Seconds by which the take's stamps run ahead of the robot's. Found from the motion when not given, wherever the
        two clocks begin; a lag of the robot behind its command is part of what is found where the robot reports no
        pose.

    Returns
    -------
    CalibrationLog
        The robot's, with `tracker_cp`: NaN where the take saw nothing near in time.

    Raises
    ------
    LogError
        The robot's recording has a tracker already, no pose, or a clock that starts anew; the take has no tracker;
        the motion does not determine how the clocks lie, or they share no time.
    """
    if robot.tracker_cp is not None:
        raise LogError("the robot's recording has a tracker of its own.", hint="Give one tracker.", path=robot.name)
    if take.tracker_cp is None:
        raise LogError("expected a recording with a tracker.", path=take.name)
    for log in (robot, take):
        if log.static or len(log) < 2 or not np.all(np.diff(log.time) > 0):
            raise LogError("expected one clock that runs through the whole recording.", path=log.name)
    seen = Stream("tracker_cp", take.time, take.tracker_cp, source=take.name)
    shift, remark = _shift(robot, seen, ahead)
    pose = cast(PoseSignal, interpolate(seen, robot.time + shift))
    missing = ~np.isfinite(pose.position).all(axis=1)
    if missing.all():
        raise LogError("the recordings share no time.", hint=_HINT, path=take.name)
    extra = {
        name: np.asarray(interpolate(Stream(name, take.time, values), robot.time + shift))
        for name, values in take.extra.items()
        if name not in robot.extra
    }
    lost = [f"{missing.sum()} of {len(robot)} samples have no tracker."] if missing.any() else []
    return replace(
        robot,
        tracker_cp=pose,
        extra={**robot.extra, **extra},
        meta=replace(robot.meta, tracker=robot.meta.tracker or take.meta.tracker),
        name=f"{robot.name} + {take.name}",
        remarks=(*robot.remarks, *take.remarks, remark, *lost),
    )


def _shift(robot: CalibrationLog, seen: Stream, ahead: float | None) -> tuple[FloatArray | float, str]:
    """Seconds to add to the robot's stamps, and where they come from."""
    if ahead is not None:
        return ahead, f"the tracker's clock runs {ahead:g} s ahead, as was given."
    name = next((n for n in REFERENCES["tracker_cp"] if n in robot.signals), None)
    if name is None:
        raise LogError("the robot's recording has no pose to match clocks by.", hint=_HINT, path=robot.name)
    # Every shift at which the two recordings overlap is tried.
    span = (np.ptp(robot.time) + np.ptp(seen.stamp)) / 2
    apart = (seen.stamp[-1] + seen.stamp[0] - robot.time[-1] - robot.time[0]) / 2
    reference = Stream(name, robot.time, getattr(robot, name))
    found = stream_offset(seen, reference, max_lag=float(span), centre=float(apart))
    doubt = _doubt(found, robot.time, seen.stamp)
    if doubt:
        raise LogError(f"the motion does not tell how the clocks lie: {doubt}", hint=_HINT, path=seen.source)
    shift = found.at(robot.time + found.offset)
    remark = f"the tracker's clock runs {found.offset:.4f} s ahead{_rate(found, shift)}, found by {name}."
    if name == "measured_cp":
        remark += " Slack between the motors and the tool makes it late, too; give --time-offset if it is known."
    if name == "setpoint_cp":
        remark += (
            " What the robot lags behind its commands is taken for clock with it, and is not learned or measured: "
            "record measured_cp as well, or give --time-offset."
        )
    return shift, remark


def _rate(found: TimeOffset, shift: FloatArray) -> str:
    """Say by how much one clock is faster, and what a constant number loses by that."""
    if found.drift is None:
        return ""
    lost = 1e3 * np.abs(shift - found.offset).max()
    return (
        f" in the middle, and {found.drift.ppm:+.1f} ppm fast, which is followed (a constant --time-offset would lose "
        f"{lost:.0f} ms at the ends)"
    )


def _doubt(found: TimeOffset, robot: FloatArray, take: FloatArray) -> str:
    """Why not to believe what was found, empty if it may be believed.

    Among all shifts of two long recordings some make short pieces of unrelated motions look alike.
    """
    if not found.observable:
        return found.reason
    if found.explained < SAME_MOTION:
        return f"at the best shift one explains only {found.explained:.0%} of the other."
    start, stop = max(robot[0] + found.offset, take[0]), min(robot[-1] + found.offset, take[-1])
    fraction = (stop - start) / min(np.ptp(robot), np.ptp(take))
    if fraction < IN_COMMON:
        return f"at the best shift they share only {fraction:.0%} of the shorter recording."
    return ""
