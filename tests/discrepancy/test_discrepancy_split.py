"""The split: dealt once, whole trajectories, no part empty, and what is new in a session is learned in its opening."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.discrepancy.recording.split import split_rows
from gpcorrect.errors import DataError

ROWS = 30


def table(trajectories: int, sessions: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return trajectory and session of equally long trajectories."""
    number = np.repeat(np.arange(trajectories), ROWS)
    return number, number * sessions // trajectories


def test_parts_hold_whole_trajectories() -> None:
    """Every trajectory lies in one part, and the shares are 60 : 20 : 20."""
    number, session = table(20)
    split = split_rows(number, session, np.random.default_rng(0))
    parts = np.array([np.unique(split.part[number == k]) for k in range(20)])
    assert parts.shape == (20, 1)
    assert np.bincount(parts[:, 0]).tolist() == [12, 4, 4]


def test_blocks_are_numbered_as_they_stand() -> None:
    """Whatever number a log gives its trajectories."""
    for n in (20, 4):  # whole trajectories, and pieces of a few
        number, session = table(n)
        split, renamed = (split_rows(t, session, np.random.default_rng(0)) for t in (number, 7 * number.max() - number))
        assert (split.block == renamed.block).all()
        assert (split.part == renamed.part).all()


def test_the_seed_alone_deals() -> None:
    """The same seed gives the same parts, another one others."""
    number, session = table(20)
    first, again, other = (split_rows(number, session, np.random.default_rng(s)).part for s in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


def test_sessions_stay_apart_but_for_their_opening() -> None:
    """With three sessions or more, parts are sessions; the opening of each is in discovery."""
    number, session = table(25, sessions=5)
    split = split_rows(number, session, np.random.default_rng(0))
    for k in range(5):
        rows = session == k
        assert split.part[rows][0] == 0
        assert len(np.unique(split.part[rows & (number > number[rows][0])])) == 1


@pytest.mark.parametrize("seed", range(5))
def test_two_sessions_are_in_every_part(seed: int) -> None:
    """A homing that is off in the second session alone can be found, confirmed and measured."""
    number, session = table(20, sessions=2)
    split = split_rows(number, session, np.random.default_rng(seed))
    assert all(set(split.part[session == k]) == {0, 1, 2} for k in range(2))


def test_few_long_trajectories_are_cut_with_gaps() -> None:
    """Fewer than ten trajectories are cut into blocks with rows left out between them."""
    split = split_rows(np.zeros(2000, dtype=np.int64), np.zeros(2000, dtype=np.int64), np.random.default_rng(0))
    assert split.block.max() + 1 == 20
    assert (split.block == -1).sum() >= 19
    assert all((split.part == k).any() for k in range(3))


@pytest.mark.parametrize("seed", range(3))
def test_one_trajectory_is_cut_into_pieces_of_every_part(seed: int) -> None:
    """Blocks stay numbered as they stand, five pieces in a row have all parts, and other trajectories theirs."""
    number, session = table(20)
    whole = split_rows(number, session, np.random.default_rng(seed))
    split = whole.in_pieces(number == 7, 3, np.random.default_rng(seed))
    assert (np.diff(split.block) >= 0).all()
    assert len(np.unique(split.block)) == 20 - 1 + ROWS // 3
    assert (split.part[number != 7] == whole.part[number != 7]).all()
    own = split.part[number == 7].reshape(-1, 3)
    assert (own == own[:, :1]).all()
    assert all(sorted(five) == [0, 0, 0, 1, 2] for five in own[:, 0].reshape(-1, 5))


def test_one_sample_is_too_few() -> None:
    """What cannot be dealt to three parts is refused."""
    one = np.zeros(1, dtype=np.int64)
    with pytest.raises(DataError, match="separate motions"):
        split_rows(one, one, np.random.default_rng(0))
