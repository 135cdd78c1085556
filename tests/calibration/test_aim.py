"""Laws of commands moved by what they would miss: they arrive nearer, a stream is its path, nonsense is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log, reached

from gpcorrect.calibration import FitSettings, JointCorrector, fit_model
from gpcorrect.calibration.aim import Aim
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray

SETTINGS = FitSettings(method="linear", features=("position", "velocity", "memory"), input_signal="setpoint_jp")


def commanded_log(seed: int) -> CalibrationLog:
    """Return a recording of commanded joints, and of those that slack leaves of them."""
    log = joint_log(seed, trajectories=6)
    return replace(log, setpoint_jp=log.measured_jp, measured_jp=None, measured_jf=None)


@pytest.fixture(scope="module")
def models() -> tuple[JointCorrector, Aim]:
    """Return what says which command a place needs, and what moves these commands."""
    log = commanded_log(0)
    first, back = (
        fit_model(log, replace(SETTINGS, direction=d), task=JointCorrector).corrector for d in ("command", "estimate")
    )
    found = first.correct_path(log.external_jp, log.time).joints
    return first, Aim.learn(back, log.external_jp - back.correct_path(log.setpoint_jp, log.time).joints, log, found)


def desired() -> tuple[FloatArray, FloatArray]:
    """Return places that other commands have reached, without noise, and their times."""
    log = commanded_log(7)
    assert log.setpoint_jp is not None
    return reached(log.setpoint_jp), log.time


def test_a_machine_arrives_nearer(models: tuple[JointCorrector, Aim]) -> None:
    """Sent through the machine's own slack, moved commands miss by less than half in every joint."""
    first, aim = models
    q, time = desired()
    told = first.correct_path(q, time).joints
    moved, beyond = aim.moved(q, told, time, [0] * len(q))
    assert beyond.mean() < 0.05
    missed = [np.sqrt(((reached(u) - q)[5:] ** 2).mean(axis=0)) for u in (told, moved)]
    assert (missed[1] < 0.5 * missed[0]).all()


def test_joints_whose_commands_get_worse_are_not_moved(models: tuple[JointCorrector, Aim]) -> None:
    """Where what was found is what was commanded, a model that errs by more than it sees missing moves none."""
    log = commanded_log(0)
    near = log.setpoint_jp + 1e-6
    assert not Aim.learn(models[1].reached, np.ones((1, 3)), log, near).share.any()


def test_a_stream_is_its_path(models: tuple[JointCorrector, Aim]) -> None:
    """Sample by sample, also after a missing one, the same commands."""
    first, aim = models
    q, time = (part[:80] for part in desired())
    told = np.array(first.correct_path(q, time).joints)
    told[40] = np.nan
    told[60:] += 0.5
    (path, beyond), stream = aim.moved(q, told, time, [0] * len(q)), aim.stream()
    found, outside = zip(*(stream.moved(*row) for row in zip(time, q, told, strict=True)), strict=True)
    np.testing.assert_allclose(found, path, atol=1e-9)
    np.testing.assert_array_equal(outside, beyond)
    assert beyond[62:].all()
    assert np.isnan(path[40]).all()


def test_a_command_moved_at_once_does_not_look_fast() -> None:
    """On a machine that lags by 30 ms of its speed, 20 mdeg within a millisecond move commands by no more than that."""
    log = commanded_log(0)
    assert log.setpoint_jp is not None
    speed = np.gradient(log.setpoint_jp, log.time, axis=0)
    lagging = replace(log, external_jp=log.setpoint_jp - 0.03 * speed)
    settings = replace(SETTINGS, features=("position", "velocity"), direction="estimate")
    aim = Aim(fit_model(lagging, settings, task=JointCorrector).corrector, np.full(3, 0.5))
    q, jitter = log.setpoint_jp, np.radians(0.02) * np.array([1.0, 1.0, 0.1])
    time, path = np.ravel(log.time[:, None] + [0.0, 1e-3]), np.stack([q, q + 1e-3 * speed], axis=1)
    moved, _ = aim.moved(path.reshape(-1, 3), (path + [[0.0], [1.0]] * jitter).reshape(-1, 3), time, [0] * len(time))
    steps = np.abs(np.diff(moved, axis=0)[::2])[50:]
    assert np.quantile(steps / jitter, 0.99, axis=0).max() < 3.0  # the motion itself is one


def test_a_path_to_go_along_is_as_long(models: tuple[JointCorrector, Aim]) -> None:
    """One row too few is refused, and the path itself changes nothing."""
    q, time = (part[:40] for part in desired())
    with pytest.raises(DataError, match="a path of 40 samples"):
        models[0].correct_path(q, time, along=q[1:])
    same = models[0].correct_path(q, time, along=models[0].view.reached(q)).joints
    np.testing.assert_array_equal(same, models[0].correct_path(q, time).joints)


def test_shares_that_cannot_be_are_refused(models: tuple[JointCorrector, Aim]) -> None:
    """More than all of what is missing, of another arm, or by a model of the other direction."""
    first, aim = models
    for share in (np.full(3, 1.5), np.full(3, np.nan), np.ones(4)):
        with pytest.raises(DataError, match="does not move commands"):
            Aim(aim.reached, share)
    with pytest.raises(DataError, match="direction command"):
        Aim(first, aim.share)
