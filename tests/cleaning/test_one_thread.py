"""Linear algebra on one thread, wherever the work is called from."""

from __future__ import annotations

import numpy as np
from cleaning_synthetic import World, make_log
from threadpoolctl import threadpool_info, threadpool_limits

from gpcorrect.cleaning import fit_cleaner
from gpcorrect.one_thread import on_one_thread


def threads() -> int:
    """Return the most threads that a library of linear algebra may use."""
    return max(int(pool["num_threads"]) for pool in threadpool_info() if pool["user_api"] == "blas")


class Watching(np.random.Generator):
    """Remembers on how many threads the work is done that draws from it."""

    seen: frozenset[int] = frozenset()

    def choice(self, *args, **kwargs):
        self.seen |= {threads()}
        return super().choice(*args, **kwargs)


def test_work_is_done_on_one_thread_and_others_are_left_as_they_were() -> None:
    """Inside there is one, afterwards as many as before."""
    with threadpool_limits(2):
        assert on_one_thread(threads)() == 1
        assert threads() == 2


def test_cleaning_called_by_itself_uses_one_thread() -> None:
    """Two pools on two cores fight each other: cleaning took 15 s of processor time in place of two."""
    rng = Watching(np.random.PCG64(0))
    with threadpool_limits(2):
        fit_cleaner(make_log(World(reaches=6), np.random.default_rng(0)), rng=rng)
    assert rng.seen == {1}
