"""Checks of a log: each a small object that asks one question; a new check is one line here."""

from __future__ import annotations

from gpcorrect.logs.checks.clock import Gaps, Jitter, Stamps, TimeUnit
from gpcorrect.logs.checks.evidence import Check, Evidence
from gpcorrect.logs.checks.finding import Finding, Severity
from gpcorrect.logs.checks.geometry import Handedness, Kinematics, Unrelated
from gpcorrect.logs.checks.limits import JointLimits
from gpcorrect.logs.checks.motion import Frozen, Speed
from gpcorrect.logs.checks.orientation import Inverted, QuaternionNorm, QuaternionSign
from gpcorrect.logs.checks.presence import Constant, Loopback, Missing, Purpose
from gpcorrect.logs.checks.timing import ClockOffset
from gpcorrect.logs.checks.trajectories import Trajectories
from gpcorrect.logs.checks.units import JointUnit, PositionUnit

__all__ = ["CHECKS", "Check", "Evidence", "Finding", "Severity"]

CHECKS: tuple[Check, ...] = (
    Stamps(),
    TimeUnit(),
    Jitter(),
    Gaps(),
    Trajectories(),
    Purpose(),
    Missing(),
    Constant(),
    Loopback(),
    PositionUnit(),
    JointUnit(),
    JointLimits(),
    QuaternionNorm(),
    QuaternionSign(),
    Inverted(),
    Frozen(),
    Speed(),
    Handedness(),
    Kinematics(),
    Unrelated(),
    ClockOffset(),
)
