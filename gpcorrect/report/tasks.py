"""What the pages call the paths and errors of each task, and the path that all others are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpcorrect.calibration import CommandCorrector, Corrector, JointCorrector, Measured
from gpcorrect.calibration.joint_view import directed
from gpcorrect.report.charts import Role
from gpcorrect.types import CalibrationLog, FloatArray

METHOD_ROLES = (Role.RAW, Role.RIGID, Role.CORRECTED)
"""Of the three methods that are measured: before, after the simplest remedy, corrected."""
METHOD_WORDS = {
    "raw": "before",
    "rigid": "registered",
    "fixed_offset": "fixed offset",
    "corrected": "corrected",
    "estimated": "estimated",
}


@dataclass(frozen=True)
class Words:
    """Names of paths."""

    reference: str  # the path that is to be hit
    reached: str  # where the arm, or its report, was instead
    reached_method: int  # which of the three methods' errors leads there
    answer: str  # what the model gives
    errors: str  # what an error is, in a sentence


WORDS: Mapping[str, Words] = {
    "pose": Words(
        "commanded",
        "reached, registered",
        1,
        "corrected",
        "Errors are commands that were given, minus the commands that would have been given for the observed poses.",
    ),
    "estimate": Words(
        "true", "reported", 0, "corrected", "Errors are true joints minus reported, and minus corrected ones."
    ),
    "command": Words(
        "commanded", "desired", 0, "corrected", "Errors are joints that were commanded, minus those the model commands."
    ),
    "tool_position": Words(
        "true", "reported", 0, "estimated", "Errors are the tracker's positions minus reported, and estimated ones."
    ),
}


def words_of(corrector: Corrector) -> Words:
    """Return the names for a model's task."""
    return WORDS[corrector.view.direction if isinstance(corrector, JointCorrector) else corrector.TASK]


def reference(corrector: Corrector, log: CalibrationLog, measured: Measured) -> FloatArray:
    """Return what was to be hit at the measured samples `(n, d)`: positions or joints; less an error, it is a path.

    Parameters
    ----------
    corrector : Corrector
    log : CalibrationLog
        That was measured.
    measured : Measured
        n samples of it.
    """
    if isinstance(corrector, JointCorrector):
        truth = directed(log, corrector.view.input_signal, corrector.view.direction)[1]
        assert truth is not None
        return truth[measured.rows]
    if isinstance(corrector, CommandCorrector):
        assert log.setpoint_cp is not None
        return log.setpoint_cp.position[measured.rows]
    assert log.measured_cp is not None
    return np.asarray(log.measured_cp.position[measured.rows] + measured.raw)
