"""Laws of the question which pose a command reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import small_log

from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector, reached, reached_path
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel, pose_residual
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect.velocity import twists


def commands(corrector: CommandCorrector, desired: FloatArray, twist: FloatArray) -> FloatArray:
    """Return what the model commands for each desired pose."""
    answers = [corrector.correct(*query) for query in zip(desired, twist, strict=True)]
    return np.array([[*a.position, *a.quaternion] for a in answers])


@pytest.fixture
def registered(small_corrector: CommandCorrector) -> CommandCorrector:
    """Return a corrector whose marker is not its tool tip."""
    turn = RigidModel("marker", offset=[0.01, -0.02, 0.015])
    return replace(small_corrector, rigid=turn)


def test_the_pose_that_a_command_reaches_has_that_command(registered: CommandCorrector) -> None:
    """From a desired pose to its command and back is nothing, at rest and in motion."""
    desired, twist = registered.check_queries[:, :7], np.zeros((len(registered.check_queries), 6))
    for moving in (twist, twist + np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.0])):
        back = reached(registered, commands(registered, desired, moving), moving)
        found, asked = PoseSignal(back.position, back.quaternion), PoseSignal(desired[:, :3], desired[:, 3:])
        assert np.abs(pose_residual(found, asked)).max() < 1e-5
        assert back.in_domain.all()


def test_a_command_in_millimetres_is_told_the_frame_of_commands(small_corrector: CommandCorrector) -> None:
    """The refusal named a coordinate that nobody had given, and asked for the observer's frame."""
    command = commands(small_corrector, small_corrector.check_queries[:1, :7], np.zeros((1, 6)))
    command[:, :3] *= 1e3
    with pytest.raises(DataError, match="takes this command to the observer's frame, coordinate") as refused:
        reached(small_corrector, command)
    assert refused.value.hint == "Give commands in metres, in the base frame."


def test_other_reaches_end_where_it_says(small_corrector: CommandCorrector) -> None:
    """On other trajectories of the same machine its error is far below the registration's, and intervals hold it."""
    log = small_log(seed=1)
    sent = np.hstack([log.setpoint_cp.position, log.setpoint_cp.quaternion])
    velocity = np.gradient(sent[:, :3], log.time, axis=0)
    answer = reached(small_corrector, sent, np.hstack([velocity, np.zeros(velocity.shape)]))
    own = pose_residual(PoseSignal(answer.position, answer.quaternion), log.tracker_cp)
    before = pose_residual(small_corrector.rigid.inverse(log.setpoint_cp), log.tracker_cp)
    assert np.linalg.norm(own[:, :3]) < 0.2 * np.linalg.norm(before[:, :3])
    assert (np.abs(own) <= answer.interval95).mean() > 0.9


def late_log(seed: int) -> CalibrationLog:
    """Return a recording of an arm that follows its commands as a servo of 60 ms does, seen to 0.1 mm."""
    rng, step, lag = np.random.default_rng(seed), 0.02, 0.06
    time, number, sent, seen = [], [], [], []
    for k in range(12):
        t = np.arange(60) * step
        swing = 0.08 * np.sin(rng.uniform(2.5, 5.0, 3) * t[:, None] + rng.uniform(0, 2 * np.pi, 3))
        place = swing[0]
        for row in swing:
            place = place + (1 - np.exp(-step / lag)) * (row - place)
            seen.append(place + 1e-4 * rng.standard_normal(3))
        sent.append(swing)
        time.append(t + 10.0 * k)
        number.append(np.full(len(t), k))
    return CalibrationLog(
        time=np.concatenate(time),
        trajectory=np.concatenate(number),
        session=np.zeros(720),
        setpoint_cp=PoseSignal(np.concatenate(sent)),
        tracker_cp=PoseSignal(np.array(seen)),
    )


def test_a_path_is_answered_at_the_velocity_of_what_follows() -> None:
    """Behind a servo's lag poses have other velocities than their commands, by lag times acceleration."""
    settings = FitSettings(
        features=("pose", "velocity"), clean=False, inducing=60, marker="none", time_offset="none", search_samples=200
    )
    model, log, missed = fit_corrector(late_log(0), settings), late_log(1), []
    for _, rows in log.trajectories():
        sent, time = log.setpoint_cp.position[rows], log.time[rows]
        alone = reached(model, sent, np.nan_to_num(twists(time, sent, None, np.zeros(len(rows), dtype=int))))
        path = reached_path(model, sent, time)
        assert path.in_domain.mean() > 0.8
        late = slice(15, None)  # a motion begins at rest here, which no sine does
        missed.append([(a.position - log.tracker_cp.position[rows])[late] for a in (alone, path)])
    alone_error, path_error = (np.sqrt(np.mean(np.square(part))) for part in zip(*missed, strict=True))
    assert path_error < 0.55 * alone_error


def test_a_command_that_two_poses_share_is_no_known_one() -> None:
    """Of a model so steep that poses share commands, none is called inside with an interval that misses."""
    settings = FitSettings(
        features=("pose", "velocity"), clean=False, inducing=20, marker="none", time_offset="none", search_samples=60
    )
    steep = fit_corrector(debridement_log(reaches=4), settings)
    desired = steep.check_queries[:, :7]
    back = reached(steep, commands(steep, desired, np.zeros((len(desired), 6))))
    missed = np.abs(back.position - desired[:, :3]) > back.interval95[:, :3] + 1e-6
    assert not (back.in_domain & missed.any(axis=1)).any()


def test_what_was_not_used_is_said(small_corrector: CommandCorrector) -> None:
    """Without a velocity the arm is taken as at rest; far from the training nothing is promised."""
    near = small_corrector.check_queries[:1, :7]
    assert reached(small_corrector, near)[0].reason
    away = near + np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    known, unknown = reached(small_corrector, near)[0], reached(small_corrector, away)[0]
    assert not unknown.in_domain
    assert (unknown.interval95 > known.interval95).all()


def test_what_cannot_be_a_command_is_refused(small_corrector: CommandCorrector) -> None:
    """Millimetres, no rotation, NaN and a velocity too few are said to be so."""
    near = small_corrector.check_queries[:1, :7]
    for wrong in (near * [1e3, 1e3, 1e3, 1, 1, 1, 1], near * [1, 1, 1, 2, 2, 2, 2], near * np.nan):
        with pytest.raises(DataError):
            reached(small_corrector, wrong)
    with pytest.raises(DataError, match="twists must be finite"):
        reached(small_corrector, near, np.zeros(6))
