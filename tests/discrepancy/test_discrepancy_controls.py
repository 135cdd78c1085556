"""The yardsticks of a closed gap: what a black box learns, and what it does not invent."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.discrepancy.outcome.figures import black_box, exchanged


def test_the_black_box_learns_what_is_smooth_and_nothing_else() -> None:
    """A smooth function of the inputs is taken off rows that were not trained on; noise alone is left as it was."""
    rng = np.random.default_rng(4)
    inputs = rng.standard_normal((1500, 4))
    noise, smooth = rng.standard_normal(1500), 3.0 * np.sin(inputs[:, 0]) + inputs[:, 1]
    train = np.arange(1500) < 1000
    for residual, limit in ((smooth + noise, 1.25), (noise, 1.1)):
        left = black_box(inputs, residual, train, np.random.default_rng(0))
        assert 0.9 < np.std(left[~train]) < limit


def test_missing_samples_and_still_inputs_do_no_harm() -> None:
    """Rows without a measurement stay missing; an input that never varies, and a residual of zero, are nothing."""
    rng = np.random.default_rng(5)
    inputs = np.column_stack([rng.standard_normal((600, 2)), np.zeros(600)])
    residual = np.where(np.arange(600) == 7, np.nan, inputs[:, 0])
    left = black_box(inputs, residual, np.arange(600) < 400, rng)
    assert np.isnan(left).sum() == 1
    assert np.nanstd(left) < 0.05
    assert not black_box(inputs, np.zeros(600), np.arange(600) < 400, rng).any()


@pytest.mark.parametrize("trajectories", [2, 3, 7])
def test_no_trajectory_of_the_permutation_control_stays_on_its_own_motion(trajectories: int) -> None:
    """Whatever is drawn, each takes another one's content, and each one's is taken once; the test set takes no part."""
    block = np.repeat(np.arange(trajectories + 1), 5)
    train = block < trajectories
    for seed in range(50):
        taken = exchanged(block + 1.0, block, train, np.random.default_rng(seed))
        assert np.isnan(taken[~train]).all()
        source = np.abs(taken[train]).reshape(trajectories, 5)[:, 0] - 1.0
        assert (source != np.arange(trajectories)).all()
        assert sorted(source) == list(range(trajectories))
