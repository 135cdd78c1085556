"""Several logs as one."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, IntArray, LogMeta, PoseSignal

__all__ = ["join_logs"]

SAME_MACHINE = ("robot", "arm", "joint_types")


def join_logs(logs: Sequence[CalibrationLog], *, sessions: Literal["renumber", "keep"] = "renumber") -> CalibrationLog:
    """One log of all rows, in the order given, in which no trajectory runs from one log into the next.

    Trajectories are numbered anew from zero. A signal that some log lacks is dropped; the remarks say so.

    Parameters
    ----------
    logs : sequence of CalibrationLog
        At least one.
    sessions : {"renumber", "keep"}
        Number sessions anew, each log its own; or keep the numbers, when they mean the same in every log.

    Raises
    ------
    LogError
        There is no log, static poses are among recordings, or the logs are of different robots, arms or numbers of
        joints.
    """
    if not logs:
        raise LogError("expected at least one log, got none.")
    if len(logs) == 1:
        return logs[0]
    if len({log.static for log in logs}) > 1:
        raise LogError("static poses cannot be joined with recordings that have a clock.")
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
        meta=_joined_meta(logs),
        static=logs[0].static,
        name=", ".join(log.name for log in logs),
        digest=_joined_digest(logs),
        remarks=(*_remarks(logs, common), *(f"{log.name}: {r}" for log in logs for r in log.remarks)),
    )


def _renumbered(numbers: Sequence[IntArray]) -> IntArray:
    """Numbers from zero, by first appearance, that no two logs share."""
    parts, used = [], 0
    for part in numbers:
        ids, first, place = np.unique(part, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        parts.append(rank[place] + used)
        used += len(ids)
    return np.concatenate(parts)


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
    """Join what the logs say: the same once, different notes one after the other.

    Raises
    ------
    LogError
        Two logs name different machines.
    """
    merged: dict[str, Any] = {}
    for name in (f.name for f in fields(LogMeta)):
        said = list(dict.fromkeys(v for log in logs if (v := getattr(log.meta, name))))
        if name in SAME_MACHINE and len(said) > 1:
            raise LogError(f"logs of different machines cannot be joined: {name} is {' and '.join(said)}.")
        merged[name] = said[0] if len(said) == 1 else (None if name == "tracker_base" else "; ".join(said))
    frames = {log.meta.tracker_base for log in logs}
    merged["tracker_base"] = frames.pop() if len(frames) == 1 else None
    return LogMeta(**merged)


def _joined_digest(logs: Sequence[CalibrationLog]) -> str:
    if not all(log.digest for log in logs):
        return ""
    return hashlib.sha256("".join(log.digest for log in logs).encode()).hexdigest()


def _remarks(logs: Sequence[CalibrationLog], common: tuple[str, ...]) -> list[str]:
    dropped = sorted({s for log in logs for s in log.signals} - set(common))
    remarks = [f"signals that not every log has were dropped: {', '.join(dropped)}."] if dropped else []
    for name in (s for s in common if s in CalibrationLog.POSES):
        turned = [getattr(log, name).quaternion is not None for log in logs]
        if any(turned) and not all(turned):
            remarks.append(f"{name} has no orientation in every log; its positions only were kept.")
    if len({log.meta.tracker_base for log in logs}) > 1:
        remarks.append("the logs state different frames of the tracker; none was kept.")
    return remarks
