"""A lag that goes on from run to run."""

from __future__ import annotations

import numpy as np

from gpcorrect.sim.effects.operators import lag
from gpcorrect.sim.effects.sequence import lag_through


def test_runs_cut_from_one_another_lag_as_the_whole_does() -> None:
    """Cut into runs with nothing between them, in any order of columns, a session's lag is that of the uncut path."""
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.01, 0.3, 400))
    path = np.cumsum(rng.normal(size=400))
    whole = lag(path, time, 7.0)
    order = [2, 0, 3, 1]
    cut = [column.reshape(4, 100).T[:, order] for column in (path, time)]
    through = lag_through(*cut, np.zeros(4, dtype=np.int64), 7.0)
    np.testing.assert_allclose(through, whole.reshape(4, 100).T[:, order], atol=1e-12)


def test_sessions_know_nothing_of_one_another() -> None:
    """The first run of a session starts in balance, whatever came before."""
    time = np.tile(np.linspace(0.0, 5.0, 50)[:, None], (1, 2)) + np.array([0.0, 6.0])
    path = np.tile(np.sin(time[:, :1]), (1, 2)) + np.array([0.0, 3.0])
    apart = lag_through(path, time, np.array([0, 1]), 4.0)
    np.testing.assert_allclose(apart, lag(path, time, 4.0))
    assert not np.allclose(lag_through(path, time, np.array([0, 0]), 4.0), apart)


def test_a_gap_is_bridged_with_what_lies_on_either_side() -> None:
    """After a gap of many time constants at one load, the next run starts in balance with that load."""
    time = np.tile(np.linspace(0.0, 1.0, 20)[:, None], (1, 2)) + np.array([0.0, 1000.0])
    path = np.concatenate([np.linspace(0.0, 2.0, 20)[:, None], np.full((20, 1), 2.0)], axis=1)
    through = lag_through(path, time, np.zeros(2, dtype=np.int64), 3.0)
    np.testing.assert_allclose(through[:, 1], 2.0, atol=1e-12)
