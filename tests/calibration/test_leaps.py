"""A sample that no arm can have reached moves no memory; one whose neighbours agree with it begins a path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.calibration import FitSettings, JointCorrector, fit_model
from gpcorrect.correction import Correction, Reason
from gpcorrect.types import FloatArray

LOG = joint_log(1, trajectories=6, seconds=12.0)
assert LOG.measured_jp is not None
assert LOG.measured_jf is not None
Q, EFFORT, TIME = LOG.measured_jp[:300], LOG.measured_jf[:300], LOG.time[:300]
SPIKES = np.array([60, 120, 121, 200])


@pytest.fixture(scope="module", params=["gp", "ukf"])
def model(request: pytest.FixtureRequest) -> JointCorrector:
    settings = FitSettings(method=request.param, inducing=60, search_samples=150)
    corrector: JointCorrector = fit_model(LOG, settings, task=JointCorrector).corrector
    # As at 100 Hz, where a step is a hundredth of the range: samples of this log are 10 times as far apart.
    return replace(corrector, trained=replace(corrector.trained, speed=corrector.trained.speed / 5))


def streamed(model: JointCorrector, q: FloatArray) -> Correction:
    stream = model.stream()
    rows = zip(TIME.tolist(), q, EFFORT, strict=True)
    return Correction.stack([stream.correct(t, joints, effort) for t, joints, effort in rows])


def spoiled() -> FloatArray:
    q = np.array(Q)
    q[SPIKES] += 3.0 * np.ptp(Q, axis=0) * np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    return q


def test_a_spike_moves_no_memory(model: JointCorrector) -> None:
    """Spikes are outside; all other answers are as sure, and what they are where those samples are left out."""
    rest = np.setdiff1d(np.arange(len(Q)), SPIKES)
    found = streamed(model, spoiled())
    stream = model.stream()
    expected = Correction.stack([stream.correct(float(TIME[i]), Q[i], EFFORT[i]) for i in rest])
    np.testing.assert_array_equal(found.joints[rest], expected.joints)
    np.testing.assert_array_equal(found.interval95[rest], expected.interval95)
    assert (found.reasons[SPIKES] & Reason.OUTSIDE).all()
    assert (found.interval95[SPIKES] > np.median(found.interval95, axis=0)).all()


def test_a_path_with_spikes_is_answered_as_its_stream(model: JointCorrector) -> None:
    """Spikes, a missing number, a lasting jump: recordings, paths and streams have one answer, in order."""
    q = spoiled()
    q[30] = np.nan
    q[250:] += np.ptp(Q, axis=0)
    found, path = streamed(model, q), model.correct_path(q, TIME, EFFORT)
    recorded = model.correct_log(replace(LOG.select(slice(0, 300)), measured_jp=q))
    for answer in (path, recorded):
        np.testing.assert_allclose(answer.joints, found.joints, atol=1e-9)
        np.testing.assert_allclose(answer.std, found.std, rtol=1e-6)
        np.testing.assert_array_equal(answer.reasons, found.reasons)


def test_an_arm_that_is_there_after_all_begins_a_path(model: JointCorrector) -> None:
    """The first sample of a jump that stays is outside; from the second on, answers are those of a path begun there."""
    q = Q + np.where(np.arange(300) >= 250, 1.0, 0.0)[:, None] * np.ptp(Q, axis=0)
    found, begun = streamed(model, q), model.stream()
    assert found.reasons[250] & Reason.OUTSIDE
    for i in range(251, 300):
        answer = begun.correct(float(TIME[i]), q[i], EFFORT[i])
        np.testing.assert_array_equal(found.joints[i], answer.joints)
        np.testing.assert_array_equal(found.std[i], answer.std)


def test_a_measure_of_a_log_with_spikes_is_in_its_order(model: JointCorrector) -> None:
    """Rows, times and errors of what is measured are those of the log."""
    log = replace(LOG.select(slice(0, 300)), measured_jp=spoiled())
    measured = model.measure(log, np.ones(300, dtype=bool))
    answer = model.correct_log(log)
    assert (np.diff(measured.rows) > 0).all()
    np.testing.assert_array_equal(measured.time, log.time[measured.rows])
    np.testing.assert_allclose(measured.corrected, (log.external_jp - answer.joints)[measured.rows], atol=1e-12)
