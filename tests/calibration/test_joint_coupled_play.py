"""Plays whose cables pull on each other."""

from __future__ import annotations

import numpy as np
import pytest
from joint_logs import HALF, LIMITS, PLAY, joint_log

from gpcorrect.calibration import timed, zigzag
from gpcorrect.calibration.coupled_play import CoupledPlay, learn_coupled_play
from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.joint_path import joint_path
from gpcorrect.calibration.learners.gp import _gain, _levels, _local_level
from gpcorrect.play import play_states


def walk(seed: int = 0, n: int = 400) -> np.ndarray:
    return np.cumsum(0.05 * np.random.default_rng(seed).standard_normal((n, 3)), axis=0)


def test_without_coupling_each_joint_is_a_play_of_its_own() -> None:
    """A diagonal stiffness gives the lags of single plays."""
    path, new = walk(), np.arange(400) == 0
    lags = CoupledPlay(np.eye(3), np.full(3, 0.1)).lags(path, new)
    single = play_states(np.diff(path, axis=0, prepend=path[:1]), np.full((1, 3), 0.1), np.zeros(400, dtype=np.int64))
    np.testing.assert_allclose(lags, single[:, 0], atol=1e-12)


def test_no_joint_is_pulled_harder_than_friction_bears() -> None:
    """The cables' pull K lag stays within K_ii gap_i, and is that where a joint slips."""
    path = walk(1)
    lags = PLAY.lags(path, np.arange(400) == 0)
    pull, limit = lags @ PLAY.stiffness, np.diag(PLAY.stiffness) * PLAY.gap
    assert (np.abs(pull) <= limit + 1e-7).all()
    slips = np.abs(np.diff(path - lags, axis=0)) > 1e-6
    np.testing.assert_allclose(np.abs(pull[1:])[slips], np.broadcast_to(limit, slips.shape)[slips], atol=1e-6)


def test_a_path_in_steps_is_the_path_at_once() -> None:
    """Advancing sample by sample, as a stream does, leaves the joints where the whole path leaves them."""
    path = walk(3, 60)
    joints, seen = path[0], [path[0]]
    for motors in path[1:]:
        joints = PLAY.advance(joints, motors)
        seen.append(joints)
    np.testing.assert_array_equal(path - np.array(seen), PLAY.lags(path, np.arange(60) == 0))


@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_those_of_finite_differences(seed: int) -> None:
    """By each gap, each pair of entries of the stiffness, and the diagonal: to 1e-6 where stick and slip stay."""
    path, new, step = walk(seed), np.isin(np.arange(400), (0, 150)), 1e-7
    lags, slopes = PLAY.lags_and_slopes(path, new)
    np.testing.assert_array_equal(lags, PLAY.lags(path, new))
    eye = np.eye(3)
    moves = [(np.zeros((3, 3)), row) for row in eye]
    moves += [(np.outer(eye[i], eye[j]) + np.outer(eye[j], eye[i]), np.zeros(3)) for i, j in ((0, 1), (0, 2), (1, 2))]
    moves += [(eye, np.zeros(3))]
    for e, (stiffness, gap) in enumerate(moves):
        up, down = (
            CoupledPlay(PLAY.stiffness + way * stiffness, PLAY.gap + way * gap).lags(path, new) for way in (step, -step)
        )
        off = np.abs(slopes[:, :, e] - (up - down) / (2 * step))
        assert np.quantile(off, 0.98) < 1e-6
        assert np.abs(slopes[:, :, e]).max() > 0.1


def test_planted_slack_is_found() -> None:
    """Stiffness and gaps come back from errors that they made."""
    log = joint_log(5)
    path, n = (np.asarray(log.measured_jp) - LIMITS.mean(axis=1)) / HALF, len(log)
    error = np.subtract(log.external_jp, log.measured_jp)
    found = learn_coupled_play(path, error, np.arange(n) == 0, np.arange(n), np.ones(3, dtype=bool))
    np.testing.assert_allclose(found.gap, PLAY.gap, rtol=0.1)
    assert found.stiffness[0, 1] == pytest.approx(0.5, abs=0.1)


def test_a_zero_that_moves_is_followed_and_one_that_holds_is_not() -> None:
    """Steps of the first joint's zero are found to their end; noise alone gives no zero."""
    rng = np.random.default_rng(4)
    number = np.repeat(np.arange(20), 50)
    errors = 0.05 * rng.standard_normal((1000, 2))
    errors[:, 0] += 0.1 * number
    _, zero = _local_level(errors, number)
    assert zero[0] == pytest.approx(0.95, abs=0.2)
    assert zero[1] == 0.0


@pytest.mark.parametrize(("kept", "most"), [(0.5, 1.1), (1.0, 0.6)])
def test_a_zero_that_returns_by_itself_is_hardly_followed(kept: float, most: float) -> None:
    """It costs later trajectories a tenth of their squares at most; following one that walks spares nearly half."""
    rng = np.random.default_rng(0)
    levels = np.zeros((2000, 25))
    for k in range(1, 25):
        levels[:, k] = kept * levels[:, k - 1] + rng.standard_normal(2000)
    known, later = levels[:, :20], levels[:, 20:]
    centres = known.mean(axis=1)
    stood = [_levels(row, _gain(row))[-1] for row in known - centres[:, None]]
    followed, still = (((later.T - at) ** 2).mean() for at in (centres + stood, centres))
    assert followed < most * still


def test_what_the_motion_does_not_show_is_not_learned() -> None:
    """A joint that never turns back leaves its slack out, one that knows one speed its velocity; the fit says so."""
    limits = np.array([[0.3, 1.1], [0.9, 1.9], [0.30, 0.42]])
    path = timed(zigzag("J1", 3, limits), np.array([0.05, 0.05, 0.01]), 10.0)
    known = joint_path(path.time, np.zeros(len(path.time), dtype=np.int64), path.q, None)
    error = np.full(path.q.shape, 0.01)
    kinds = ("position", "velocity", "memory")
    learned = JointFeatures.learn(kinds, known, error, np.arange(len(path.time)))
    assert learned.remarks((1, 2, 3)) == (
        *(f"joint {j} always moves at one speed in training: its velocity is not used" for j in (1, 2, 3)),
        *(f"joint {j} hardly turns back in training: its memory is not used" for j in (2, 3)),
    )
    assert learned.transform(known).shape[1] == 3 + 4
    assert learned.smooth.tolist() == [0, 1, 2, 3]
    log = joint_log(1)
    rich = joint_path(log.time, log.session, np.asarray(log.measured_jp), None)
    error = np.subtract(log.external_jp, log.measured_jp)
    assert JointFeatures.learn(kinds, rich, error, np.arange(len(log))).remarks((1, 2, 3)) == ()
