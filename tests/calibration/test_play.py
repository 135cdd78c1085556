from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.calibration.dataset import path_starts
from gpcorrect.play import play_states
from gpcorrect.sim.effects.operators import play

RADII = np.array([[0.1, 0.3], [0.5, 0.02]])


def walk(seed: int, n: int = 300) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(0, 0.1, (n, 2)), axis=0)


def states_of(path: np.ndarray, labels: np.ndarray | None = None) -> np.ndarray:
    steps = np.diff(path, axis=0, prepend=path[:1])
    return play_states(steps, RADII, np.zeros(len(path), dtype=int) if labels is None else labels)


@pytest.mark.parametrize("seed", range(5))
def test_a_state_is_how_far_the_play_lags_behind(seed: int) -> None:
    """States equal input minus output of the play operator that the simulator has, for every radius and column."""
    path = walk(seed)
    states = states_of(path)
    for h in range(2):
        for k in range(2):
            np.testing.assert_allclose(states[:, h, k], path[:, k] - play(path[:, k], RADII[h, k]), atol=1e-12)


def test_every_label_is_a_path_of_its_own() -> None:
    """Two paths in one array have the states that each has alone, and start in the middle of the slack."""
    one, other = walk(3), walk(4)
    both = states_of(np.concatenate([one, other]), np.repeat([5, 2], 300))
    np.testing.assert_array_equal(both[:300], states_of(one))
    np.testing.assert_allclose(both[300:], states_of(other), atol=1e-12)


def test_motions_without_a_pause_between_are_one_path() -> None:
    """Paths begin with the session, where time runs back, after a pause, and nowhere else."""
    time = np.concatenate(
        [np.arange(0, 1, 0.01), np.arange(5.2, 6, 0.01), np.arange(16.5, 17, 0.01), np.arange(0, 1, 0.01)]
    )
    session = np.repeat([0, 1], [len(time) - 50, 50])
    begins = np.flatnonzero(path_starts(time, session, np.ones(len(time), dtype=bool)))
    np.testing.assert_array_equal(begins, [0, 180, 230, len(time) - 50])


def test_no_samples_are_no_path() -> None:
    """An empty recording has no beginnings, a single sample begins a path."""
    none = np.zeros(0)
    assert path_starts(none, none.astype(int), none.astype(bool)).shape == (0,)
    assert path_starts(np.zeros(1), np.zeros(1, dtype=int), np.ones(1, dtype=bool)).tolist() == [True]
