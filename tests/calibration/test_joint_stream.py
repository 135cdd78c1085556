"""Streams of joints: the same answers as the whole path, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log
from support import few_trees

from gpcorrect.calibration import LEARNERS, FitSettings, JointCorrector, JointStream, fit_model
from gpcorrect.errors import DataError

LOG = joint_log(1, trajectories=6, seconds=12.0)
assert LOG.measured_jp is not None
assert LOG.measured_jf is not None
Q, EFFORT = LOG.measured_jp, LOG.measured_jf


def fitted(method: str) -> JointCorrector:
    settings = FitSettings(method=method, inducing=60, search_samples=150, epochs=60)
    with few_trees():
        corrector: JointCorrector = fit_model(LOG, settings, task=JointCorrector).corrector
    return corrector


@pytest.fixture(scope="module")
def gp() -> JointCorrector:
    return fitted("gp")


@pytest.mark.parametrize("method", LEARNERS)
def test_a_stream_answers_as_the_path_does(method: str) -> None:
    """Every method gives sample by sample what it gives of the whole recording, through a gap and a missing number.

    So does a stream that answers every fifth sample, and only follows the others.
    """
    corrector = fitted(method)
    q = np.array(Q)
    q[100] = np.nan
    time = LOG.time + np.where(np.arange(len(q)) > 200, 60.0, 0.0)
    path = corrector.correct_log(replace(LOG, measured_jp=q, time=time))
    stream, sparse = JointStream(corrector), JointStream(corrector)
    for i in range(300):
        if i % 5:
            sparse.follow(float(time[i]), q[i], EFFORT[i])
        else:
            np.testing.assert_allclose(
                sparse.correct(float(time[i]), q[i], EFFORT[i]).joints, path.joints[i], atol=1e-9
            )
        answer = stream.correct(float(time[i]), q[i], EFFORT[i])
        np.testing.assert_allclose(answer.joints, path.joints[i], atol=1e-9)
        np.testing.assert_allclose(answer.std, path.std[i], rtol=1e-6)
        assert answer.reasons == path.reasons[i]


def test_a_fast_stream_is_as_sure_as_the_training(gp: JointCorrector) -> None:
    """Twenty times the training's rate, with an encoder's last digit jumping, the estimates stay those of the path."""
    fine = np.linspace(LOG.time[0], LOG.time[150], 150 * 20 + 1)
    jitter = 1e-5 * np.random.default_rng(0).standard_normal((len(fine), 3))
    q, effort = (np.column_stack([np.interp(fine, LOG.time, c) for c in part.T]) for part in (Q, EFFORT))
    stream = JointStream(gp)
    fast = np.array([stream.correct(t, *row).joints for t, *row in zip(fine, q + jitter, effort, strict=True)])
    away = np.abs(fast[20::20] - gp.correct_log(LOG).joints[1:151])
    assert np.median(away, axis=0) == pytest.approx(np.zeros(3), abs=2e-4)


def test_bad_samples_are_refused_and_the_past_is_kept(gp: JointCorrector) -> None:
    """Wrong sizes and time that stands still are named; the next good sample goes on as if they had not been."""
    one, other = JointStream(gp), JointStream(gp)
    for i in range(40):
        answers = [s.correct(float(LOG.time[i]), Q[i], EFFORT[i]).joints for s in (one, other)]
        np.testing.assert_array_equal(*answers)
        with pytest.raises(DataError, match="advance"):
            one.correct(float(LOG.time[i]), Q[i], EFFORT[i])
        with pytest.raises(DataError, match="3 joints"):
            one.correct(float(LOG.time[i] + 1), Q[i, :2])
    missing = one.correct(float(LOG.time[40]), Q[40])
    assert np.isnan(missing.joints).all()
    assert missing.status == "MISSING"


def test_the_clock_of_a_stream_goes_on_behind_a_missing_number(gp: JointCorrector) -> None:
    """The path begins anew, but time does not: only reset() takes an earlier one."""
    stream = JointStream(gp)
    stream.correct(5.0, Q[0], EFFORT[0])
    stream.correct(5.1, np.full(3, np.nan), EFFORT[1])
    with pytest.raises(DataError, match="advance"):
        stream.correct(5.05, Q[1], EFFORT[1])
    stream.reset()
    stream.correct(0.0, Q[1], EFFORT[1])


def test_every_session_has_a_clock_of_its_own(gp: JointCorrector) -> None:
    """A clock that begins anew with a homing begins a path of its own; within a session it is refused."""
    time, efforts = np.tile(LOG.time[:50], 2), np.tile(EFFORT[:50], (2, 1))
    twice, sessions = np.tile(Q[:50], (2, 1)), np.repeat([0, 1], 50)
    answer = gp.correct_path(twice, time, efforts=efforts, sessions=sessions)
    np.testing.assert_allclose(answer.joints[:50], answer.joints[50:], atol=1e-12)
    with pytest.raises(DataError, match="increasing"):
        gp.correct_path(twice, time, efforts=efforts)


def test_a_planner_that_sends_no_efforts_is_told_what_it_can_do(gp: JointCorrector) -> None:
    """It sends them, or asks for another model: features are the business of who fits."""
    with pytest.raises(DataError, match="none came with the joints") as refused:
        gp.correct_path(Q[:5], LOG.time[:5])
    assert "Send the effort of every joint, or ask for a model" in str(refused.value.hint)
