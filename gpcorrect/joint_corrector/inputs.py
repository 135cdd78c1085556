"""Recordings from which no joint calibration may be learned, and those that deserve a word."""

from __future__ import annotations

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs import validate_log
from gpcorrect.types import CalibrationLog

__all__ = ["joint_input_remarks"]


def joint_input_remarks(log: CalibrationLog) -> tuple[str, ...]:
    """Return what is odd but bearable about a log's joints, a sentence each.

    Raises
    ------
    LogError
        Most samples lie beyond the limits of the arm that the log names, or a trajectory runs from one session, a
        homing, into the next.
    """
    for number, rows in log.trajectories():
        sessions = np.unique(log.session[rows])
        if len(sessions) > 1:
            raise LogError(
                f"trajectory {number} runs through sessions {', '.join(map(str, sessions))}: a homing lies inside it.",
                hint="Number the motions before and after the homing apart in the `trajectory` column.",
                path=log.name,
            )
    report = validate_log(log, ("joint_limits",))
    if report.errors:
        raise LogError(report.errors[0].message, hint=report.errors[0].hint, path=log.name)
    return tuple(f"{finding.signal}: {finding.message}" for finding in report.findings)
