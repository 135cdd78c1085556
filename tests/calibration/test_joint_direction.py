"""Which joint signals a model of either direction takes from a log, and which of them it looks at."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.calibration.joint_view import directed
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray

RADIANS: FloatArray = 0.5 + np.linspace(0.0, 1.0, 20)[:, None] * np.ones(2)
DEGREES: FloatArray = np.rad2deg(RADIANS)


def logged(measured: FloatArray, external: FloatArray) -> CalibrationLog:
    """Return a log of two joints, as the robot and as outside sensors give them."""
    number = np.zeros(20)
    return CalibrationLog(np.arange(20.0), number, number, measured_jp=measured, external_jp=external)


def test_what_a_command_does_not_need_may_be_in_any_unit() -> None:
    """Desired joints are asked about alone: what the robot reported beside them is looked at to learn from only."""
    log = logged(DEGREES, RADIANS)
    given, _ = directed(log, "measured_jp", "command", needs_truth=False)
    np.testing.assert_array_equal(given, RADIANS)
    with pytest.raises(LogError, match=r"joint 1 of measured_jp is typically .*degrees"):
        directed(log, "measured_jp", "command")


def test_true_joints_that_are_logged_must_be_in_radians() -> None:
    """A recording whose own truth is in degrees is refused, also where only estimates are asked for."""
    with pytest.raises(LogError, match=r"joint 1 of external_jp is typically .*degrees"):
        directed(logged(RADIANS, DEGREES), "measured_jp", "estimate", needs_truth=False)
