"""Streams of joints: the same answers as the whole path, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.errors import DataError
from gpcorrect.joint import joint_data
from gpcorrect.joint_corrector import METHODS, JointCorrector, JointSettings, JointStream, Method, fit_joint

LOG = joint_log(1, trajectories=6)


def fitted(method: Method) -> JointCorrector:
    return fit_joint(LOG, JointSettings(method=method, inducing=60)).corrector


@pytest.fixture(scope="module")
def gp() -> JointCorrector:
    return fitted("gp")


@pytest.mark.parametrize("method", METHODS)
def test_a_stream_answers_as_the_path_does(method: Method) -> None:
    """Every method gives sample by sample what it gives of the whole recording, through a gap and a missing number."""
    corrector = fitted(method)
    q = np.array(LOG.measured_jp)
    q[100] = np.nan
    time = LOG.time + np.where(np.arange(len(q)) > 200, 60.0, 0.0)
    data = joint_data(replace(LOG, measured_jp=q, time=time))
    path = corrector.estimate(data)
    assert data.effort is not None
    stream = JointStream(corrector)
    for i in range(300):
        answer = stream.estimate(float(time[i]), data.q[i], data.effort[i])
        np.testing.assert_allclose(answer.q, path.q[i], atol=1e-9)
        np.testing.assert_allclose(answer.std, path.std[i], rtol=1e-6)


def test_a_fast_stream_is_as_sure_as_the_training(gp: JointCorrector) -> None:
    """Twenty times the training's rate, with an encoder's last digit jumping, the estimates stay those of the path."""
    data = joint_data(LOG)
    assert data.effort is not None
    fine = np.linspace(data.time[0], data.time[150], 150 * 20 + 1)
    jitter = 1e-5 * np.random.default_rng(0).standard_normal((len(fine), 3))
    q, effort = (np.column_stack([np.interp(fine, data.time, c) for c in part.T]) for part in (data.q, data.effort))
    stream = JointStream(gp)
    fast = np.array([stream.estimate(t, *row).q for t, *row in zip(fine, q + jitter, effort, strict=True)])
    away = np.abs(fast[20::20] - gp.estimate(data).q[1:151])
    assert np.median(away, axis=0) == pytest.approx(np.zeros(3), abs=2e-4)


def test_bad_samples_are_refused_and_the_past_is_kept(gp: JointCorrector) -> None:
    """Wrong sizes and time that stands still are named; the next good sample goes on as if they had not been."""
    data = joint_data(LOG)
    assert data.effort is not None
    one, other = JointStream(gp), JointStream(gp)
    for i in range(40):
        answers = [s.estimate(float(data.time[i]), data.q[i], data.effort[i]).q for s in (one, other)]
        np.testing.assert_array_equal(*answers)
        with pytest.raises(DataError, match="advance"):
            one.estimate(float(data.time[i]), data.q[i], data.effort[i])
        with pytest.raises(DataError, match="3 joints"):
            one.estimate(float(data.time[i] + 1), data.q[i, :2])
    assert np.isnan(one.estimate(float(data.time[40]), data.q[40]).q).all()
