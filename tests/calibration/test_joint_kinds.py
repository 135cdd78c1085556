"""Which joints slide, where nothing beside the recording says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, LogMeta


def unnamed(log: CalibrationLog, scale: float, middle: float) -> CalibrationLog:
    """Return a log whose kinds of joints are not said, its third joint stretched and put around another middle."""
    moved = {name: np.array(getattr(log, name)) for name in ("measured_jp", "external_jp")}
    for table in moved.values():
        table[:, 2] = middle + scale * (table[:, 2] - 0.36)
    return replace(log, **moved, meta=LogMeta())


def test_a_third_joint_that_goes_beyond_any_insertion_turns() -> None:
    """It was an insertion of a metre and a half, and its errors were printed in millimetres."""
    result = fit_model(unnamed(joint_log(1, 6), 12.0, 1.0), FitSettings(method="linear"), task=JointCorrector)
    assert result.corrector.info()["types"] == "RRR"
    assert any("all joints turn (rad)" in remark for remark in result.remarks)
    other = unnamed(joint_log(2, 4), 12.0, 1.0)
    near = other.select(np.flatnonzero(other.measured_jp[:, 2] < 0.6))
    assert near.joint_types(3) == "RRP"  # by itself it could be an insertion: it is measured by the model's kinds
    assert evaluate_model(result.corrector, near).clean.corrected.shape == (len(near), 3)


def test_an_insertion_is_one_still_and_in_millimetres_is_refused() -> None:
    """As the recordings of surgical arms that name nothing have it."""
    assert unnamed(joint_log(1, 4), 1.0, 0.36).joint_types(3) == "RRP"
    assert unnamed(joint_log(1, 4), 8.0, 0.0).joint_types(3) == "RRR"  # to both sides of its zero, by half a radian
    with pytest.raises(LogError, match="is it in mm"):
        fit_model(unnamed(joint_log(1, 4), 1000.0, 360.0), FitSettings(method="linear"), task=JointCorrector)
