"""Queries and recordings whose units cannot be those of the training are refused, at every door; others are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from joint_logs import joint_log
from support import short_search, small_log

from gpcorrect.calibration import (
    CommandCorrector,
    FitSettings,
    JointCorrector,
    PositionEstimator,
    RobotState,
    evaluate_model,
    fit_model,
    update_model,
)
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray

LOG = small_log(seed=5, trajectories=3)
WRONG = r"no arm is so far off|no seconds"


@pytest.fixture(scope="module")
def poses_model() -> CommandCorrector:
    """Return a model of poses that is soon learned."""
    settings = FitSettings(inducing=20, clean=False)
    with short_search(50):
        corrector: CommandCorrector = fit_model(small_log(trajectories=4), settings).corrector
    return corrector


def _feed(answer: Callable[..., object], *columns: Any) -> None:
    """Ask sample after sample."""
    for row in zip(*columns, strict=True):
        answer(*row)


def _path() -> tuple[FloatArray, FloatArray]:
    rows = LOG.trajectory == 1
    seen = LOG.tracker_cp
    assert seen is not None
    assert seen.quaternion is not None
    return np.hstack([seen.position, seen.quaternion])[rows], LOG.time[rows]


@pytest.mark.parametrize("rate", [0.1, 1.0, 2.0])
def test_a_path_at_another_speed_is_answered(poses_model: CommandCorrector, rate: float) -> None:
    """A path ten times slower than the training, or twice as fast, is no path in other units."""
    poses, times = _path()
    assert len(poses_model.correct_path(poses, times / rate).reasons) == len(poses)


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_path_times_in_milliseconds_are_refused(poses_model: CommandCorrector, factor: float) -> None:
    """Milliseconds or microseconds, taken for seconds, are refused by a path and by a stream."""
    poses, times = _path()
    with pytest.raises(DataError, match="no seconds"):
        poses_model.correct_path(poses, factor * times)
    stream = poses_model.stream()
    with pytest.raises(DataError, match="no seconds"):
        _feed(stream.correct, factor * times, poses)


def test_a_stream_that_pauses_is_answered(poses_model: CommandCorrector) -> None:
    """A stream that moves, waits for minutes, and moves again is answered."""
    poses, times = _path()
    stream, waits = poses_model.stream(), 100.0 * (np.arange(len(times)) // 8)
    for time, pose in zip(times + waits, poses, strict=True):
        assert stream.correct(time, pose).position is not None


@pytest.mark.parametrize("factor", [1e3, 1e2])
def test_millimetres_are_refused(poses_model: CommandCorrector, factor: float) -> None:
    """Positions in millimetres or centimetres are refused, alone, in a path and in a stream."""
    poses, times = _path()
    poses[:, :3] *= factor
    with pytest.raises(DataError, match="metres"):
        poses_model.correct(poses[0])
    with pytest.raises(DataError, match="metres"):
        poses_model.correct_path(poses, times)
    with pytest.raises(DataError, match="metres"):
        poses_model.stream().correct(0.0, poses[0])


def test_a_pose_beside_the_training_is_answered(poses_model: CommandCorrector) -> None:
    """A pose half a metre beside the training is answered, and marked."""
    assert not poses_model.correct([0.6, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]).in_domain


def test_logs_in_milliseconds_are_refused(poses_model: CommandCorrector) -> None:
    """A log in milliseconds is neither measured on nor learned from."""
    log: CalibrationLog = replace(LOG, time=1e3 * LOG.time)
    with pytest.raises(DataError, match="no seconds"):
        evaluate_model(poses_model, log)
    with pytest.raises(DataError, match="no seconds"):
        update_model(poses_model, log)


@pytest.fixture(scope="module")
def joints() -> JointCorrector:
    """Return a joint model, without noise in what it is asked."""
    settings = FitSettings(method="linear", features=("position",), clean=False)
    corrector: JointCorrector = fit_model(joint_log(2, trajectories=4), settings, task=JointCorrector).corrector
    return corrector


def test_joints_in_other_units_are_refused(joints: JointCorrector) -> None:
    """Degrees, millimetres and milliseconds are refused by paths and streams of joints; the same path in SI is not."""
    log = joint_log(3, trajectories=1)
    assert log.measured_jp is not None
    q, time = log.measured_jp, log.time
    assert joints.correct_path(q, time).in_domain.mean() > 0.9
    for wrong, times in ((q * [57.3, 57.3, 1], time), (q * [1, 1, 1000], time), (q, 1e3 * time)):
        with pytest.raises(DataError, match=WRONG):
            joints.correct_path(wrong, times)
        with pytest.raises(DataError, match=WRONG):
            _feed(joints.stream().correct, times, wrong)
    with pytest.raises(DataError, match="no seconds"):
        joints.correct_log(replace(log, time=1e3 * time))


def test_states_in_other_units_are_refused() -> None:
    """A tool position is not estimated from degrees or milliseconds."""
    log = small_log(seed=1, trajectories=4)
    q = log.setpoint_cp.position * [10.0, 10.0, 1.0]
    log = replace(log, measured_cp=log.setpoint_cp, measured_jp=q)
    settings = FitSettings(method="linear", clean=False)
    estimator: PositionEstimator = fit_model(log, settings, task=PositionEstimator).corrector
    for angle, second in ((57.3, 1.0), (1.0, 1e3)):
        states = map(RobotState, second * log.time[:60], angle * q, log.setpoint_cp.position)
        with pytest.raises(DataError, match=WRONG):
            _feed(estimator.stream().correct, states)
    with pytest.raises(DataError, match="no seconds"):
        estimator.correct_log(replace(log, time=1e3 * log.time))
