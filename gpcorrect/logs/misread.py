"""Recordings whose units or frames were misread: whatever is learned from them is wrong by as much."""

from __future__ import annotations

from gpcorrect.errors import LogError
from gpcorrect.logs.checks import Check
from gpcorrect.logs.checks.clock import TimeUnit
from gpcorrect.logs.checks.geometry import Handedness
from gpcorrect.logs.checks.orientation import Inverted
from gpcorrect.logs.checks.units import PositionUnit
from gpcorrect.logs.validate import validate_log
from gpcorrect.types import CalibrationLog

__all__ = ["refuse_misread"]

CHECKS: tuple[Check, ...] = (TimeUnit(), PositionUnit(), Handedness(), Inverted())
LEARNED_FROM = ("time", "setpoint_cp", "tracker_cp")


def refuse_misread(log: CalibrationLog) -> None:
    """Refuse a log whose times or poses cannot be in the units and frames that they are taken for.

    These are the few of :func:`validate_log`'s errors after which a fit would still run, and report figures that mean
    nothing: milliseconds, millimetres, a left-handed tracker frame, quaternions in another order.

    Raises
    ------
    LogError
        With the first such finding.
    """
    found = [f for f in validate_log(log, CHECKS).errors if f.signal in LEARNED_FROM]
    if found:
        signal, message = found[0].signal, found[0].message
        raise LogError(message if signal == "time" else f"{signal}: {message}", hint=found[0].hint, path=log.name)
