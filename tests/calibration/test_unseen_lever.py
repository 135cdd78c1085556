"""A tracker without orientations, of a marker away from the tip: said with its place, and not where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import short_search, small_log

from gpcorrect import se3
from gpcorrect.calibration import FitSettings, fit_model
from gpcorrect.types import FloatArray, PoseSignal

PLACE = np.array([0.02, -0.035, 0.04])  # of the marker in the tool's frame, m


def said(place: FloatArray, seed: int) -> list[str]:
    """Return what a fit says of a marker at this place of the tool, whose positions only are seen."""
    log = small_log(seed)
    assert log.setpoint_cp is not None
    assert log.setpoint_cp.quaternion is not None
    assert log.tracker_cp is not None
    seen = log.tracker_cp.position + se3.matrix_from_quaternion(log.setpoint_cp.quaternion) @ place
    with short_search(80):
        result = fit_model(replace(log, tracker_cp=PoseSignal(seen)), FitSettings(inducing=60))
    return [remark for remark in result.remarks if "mm from the commanded point" in remark]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_marker_away_from_the_tip_is_placed(seed: int) -> None:
    """Of positions alone and commanded orientations a marker off the tip is placed within 3 mm."""
    assert said(np.zeros(3), seed) == []
    (remark,) = said(PLACE, seed)
    found = [float(number) for number in remark.split("(")[1].split(" mm in")[0].split(", ")]
    np.testing.assert_allclose(found, 1e3 * PLACE, atol=3.0)
