"""Compiled loops divided among threads: the loops let go of the interpreter's lock, each thread has its own part."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba

WORTH_A_THREAD = 200_000  # inner steps; chosen by hand: below, starting a thread takes longer than it saves


def thread_count() -> int:
    """Threads that may be used: what numba may use, and no more than `OMP_NUM_THREADS` says where it is set."""
    allowed = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # set when numba is loaded
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(stated)) if stated.isdigit() else allowed)


def in_parts(length: int, steps: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` for parts that together make `range(length)`, side by side where that pays.

    Parameters
    ----------
    length : int
        Of the range; its items must not depend on each other.
    steps : int
        Inner steps of the whole work.
    work : callable
        Compiled without the interpreter's lock; writes its results in place.
    """
    parts = min(thread_count(), length, max(1, steps // WORTH_A_THREAD))
    if parts <= 1:
        work(0, length)
        return
    ends = [length * k // parts for k in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(work, ends[:-1], ends[1:]))
