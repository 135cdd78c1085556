"""What a log must hold to learn from it: observed poses and the commands that led there."""

from __future__ import annotations

from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, PoseSignal

__all__ = ["pose_pair"]


def pose_pair(log: CalibrationLog) -> tuple[PoseSignal, PoseSignal]:
    """Return (observed, command): `tracker_cp` and `setpoint_cp`, both without orientation when one of them has none.

    Raises
    ------
    LogError
        One of the signals is missing, or the log is empty.
    """
    missing = [name for name in ("tracker_cp", "setpoint_cp") if getattr(log, name) is None]
    if missing or log.tracker_cp is None or log.setpoint_cp is None:
        raise LogError(
            f"learning needs tracker_cp and setpoint_cp; missing: {', '.join(missing)}. "
            f"Present: {', '.join(log.signals) or 'none'}.",
            hint="Name the columns in a mapping file: --columns map.toml",
            path=log.name,
        )
    if len(log) == 0:
        raise LogError("the log holds no samples.", path=log.name)
    observed, command = log.tracker_cp, log.setpoint_cp
    if observed.quaternion is None or command.quaternion is None:
        return PoseSignal(observed.position), PoseSignal(command.position)
    return observed, command
