from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcorrect.logs.order import rising

TIMES = st.lists(st.one_of(st.integers(0, 6).map(float), st.just(float("nan")), st.just(float("inf"))), max_size=8)


@settings(max_examples=200, deadline=None)
@given(TIMES)
def test_no_choice_of_rising_samples_is_larger(times: list[float]):
    time = np.array(times)
    mask = rising(time)
    assert np.all(np.diff(time[mask]) > 0)
    assert np.isfinite(time[mask]).all()
    chosen = ([t for k, t in enumerate(times) if bits >> k & 1] for bits in range(2 ** len(times)))
    best = max(len(c) for c in chosen if np.isfinite(c).all() and all(a < b for a, b in pairwise(c)))
    assert mask.sum() == best


def test_groups_are_looked_at_each_for_itself():
    time, group = np.array([0, 5, 1, 6, 0.5, 7]), np.array([1, 2, 1, 2, 1, 2])
    mask = rising(time, group)
    for g in (1, 2):
        np.testing.assert_array_equal(mask[group == g], rising(time[group == g]))
    assert mask[group == 2].all()


def test_of_equal_stamps_the_first_is_kept():
    assert rising(np.array([0.0, 1.0, 1.0, 2.0])).tolist() == [True, True, False, True]
