"""Lone jumps of a desired path are bridged and said to be; nothing else is touched."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector
from gpcorrect.calibration.training_motion import MotionLimits
from gpcorrect.types import BoolArray, PoseSignal

LIMITS = MotionLimits(speeds=(0.3, 3.0), noise=(5e-4, 5e-3), longest=0.4)
RUN = np.zeros(300, dtype=np.int64)
TIME = np.arange(300) * 0.01


def smooth_path() -> PoseSignal:
    swing = 0.04 * np.sin(np.outer(TIME, [2.0, 1.5, 1.0]))
    return PoseSignal(swing, se3.quaternion_from_matrix(se3.matrix_from_rotvec(8 * swing)))


def jumping(path: PoseSignal, start: int, stop: int, shift: float = 0.03, turn: float = 0.0) -> PoseSignal:
    position, R = path.position.copy(), se3.matrix_from_quaternion(path.quaternion).copy()  # type: ignore[arg-type]
    position[start:stop] += shift / np.sqrt(3)
    R[start:stop] = se3.matrix_from_rotvec(np.array([[turn, 0.0, 0.0]])) @ R[start:stop]
    return PoseSignal(position, se3.quaternion_from_matrix(R))


def bridge(path: PoseSignal) -> tuple[PoseSignal, BoolArray]:
    return LIMITS.bridge(path, path, TIME, RUN)


def test_a_possible_path_is_not_touched() -> None:
    """What an arm can follow comes back as the same object, noise included."""
    rng = np.random.default_rng(0)
    path = smooth_path()
    noisy = PoseSignal(path.position + 1e-4 * rng.standard_normal((300, 3)), path.quaternion)
    same, bridged = bridge(noisy)
    assert same is noisy
    assert not bridged.any()


@pytest.mark.parametrize(("shift", "turn"), [(0.03, 0.0), (0.0, 0.8), (0.2, 1.5)])
@pytest.mark.parametrize(("start", "stop"), [(100, 101), (100, 125), (150, 188)])
def test_a_jump_is_bridged_and_named(start: int, stop: int, shift: float, turn: float) -> None:
    """A jump in position, in orientation or in both is replaced by the motion around it, and no other sample is."""
    path = smooth_path()
    mended, bridged = bridge(jumping(path, start, stop, shift, turn))
    assert np.flatnonzero(bridged).tolist() == list(range(start, stop))
    off = np.linalg.norm(mended.position - path.position, axis=1)
    assert off.max() < 0.004  # straight motion over 0.4 s of a path that bends
    np.testing.assert_array_equal(mended.position[~bridged], path.position[~bridged])


def test_what_lasts_may_be_meant() -> None:
    """A jump that lasts longer than an occlusion stays, and so does one that never comes back."""
    for stop in (160, 300):
        path = jumping(smooth_path(), 100, stop)
        mended, bridged = bridge(path)
        assert mended is path
        assert not bridged.any()


def test_a_path_that_is_too_fast_as_a_whole_is_left_to_the_model() -> None:
    """Where most steps are impossible there are no lone jumps to bridge."""
    path = smooth_path()
    fast = PoseSignal(20 * path.position, path.quaternion)
    mended, bridged = bridge(fast)
    assert mended is fast
    assert not bridged.any()


def test_runs_are_bridged_apart() -> None:
    """A step between two runs is no jump, and a sample without a run is never replaced."""
    path = jumping(smooth_path(), 150, 300)
    labels = np.repeat([0, 1], 150)
    assert not LIMITS.bridge(path, path, TIME, labels)[1].any()
    lone = jumping(smooth_path(), 100, 110)
    labels = np.where((RUN == 0) & (np.arange(300) >= 100) & (np.arange(300) < 110), -1, 0)
    assert not LIMITS.bridge(lone, lone, TIME, labels)[1].any()


def test_correct_path_says_what_it_bridged(small_corrector: CommandCorrector) -> None:
    """A planner's slip of 20 cm for 5 samples changes no other command, and its samples are LIMITED."""
    start = small_corrector.check_queries[4][:7]
    poses = np.tile(start, (60, 1))
    poses[:, 0] += 0.01 * np.sin(0.04 * np.arange(60))
    slipped = poses.copy()
    slipped[30:35, 1] += 0.2
    times = 0.02 * np.arange(60)
    right, answer = (small_corrector.correct_path(p, times) for p in (poses, slipped))
    assert [i for i, s in enumerate(answer.status) if s == "LIMITED"] == list(range(30, 35))
    assert all("bridged" in answer.reason[i] for i in range(30, 35))
    assert np.abs(answer.position - right.position).max() < 1e-4
