"""A real servo lag: the recorded arm follows its own command by tens of milliseconds."""

from __future__ import annotations

import numpy as np
from support import real_data

from gpcorrect.logs.reader import read_log
from gpcorrect.logs.sync import align, log_offset


def test_recorded_lag_is_found_and_removed():
    """Measured poses lag their setpoints by about 47 ms; aligned by that, they track several times better."""
    log = read_log(real_data("dvrk_motion_1.bag"))
    found = log_offset(log, "measured_cp", "setpoint_cp")
    assert found.observable, found.reason
    assert abs(found.offset - 0.047) < 0.002
    assert np.ptp(found.ci95) < 0.004
    aligned = align(log, found, signals=["measured_cp"])
    before = np.nanmedian(np.linalg.norm(log.measured_cp.position - log.setpoint_cp.position, axis=1))
    after = np.nanmedian(np.linalg.norm(aligned.measured_cp.position - log.setpoint_cp.position, axis=1))
    assert after < before / 3


def test_stop_and_measure_is_in_step():
    """A recording that waits at every sample shows no offset of a tenth of its step."""
    log = read_log(real_data("dvrk_random.csv"))
    found = log_offset(log)
    assert found.observable, found.reason
    assert abs(found.offset) < 0.043
