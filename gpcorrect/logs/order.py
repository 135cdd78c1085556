"""The order of time: which samples break it, and what to do about them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from math import isfinite
from typing import Literal

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.types import BoolArray, FloatArray, IntArray
from gpcorrect.velocity import GAP_STEPS

Disorder = Literal["refuse", "drop", "keep"]

CLOSEST = 1.5  # usual steps that three samples span at least: two when all is well, one where a clock told them twice
DAY = 86400.0  # s
LEAVE_OUT = "leave samples out: --drop-disordered (in Python disorder='drop')"
LATEST = 0.25  # of a recording's span: none is received later; the steps of most of it are then the usual ones


def rising(time: FloatArray, group: IntArray | None = None) -> BoolArray:
    """(n,) mask of as many samples as possible with time strictly increasing inside each group.

    One stamp from far in the future costs one sample, not all that follow. A time that is not finite is never in it.

    Parameters
    ----------
    time : (n,) array, seconds
    group : (n,) int array, optional
        Groups (trajectories) that are looked at each for itself; all one group when not given.
    """
    mask = np.zeros(len(time), dtype=np.bool_)
    order = np.arange(len(time)) if group is None else np.argsort(group, kind="stable")
    starts: IntArray | list[int] = [] if group is None else np.flatnonzero(np.diff(group[order])) + 1
    for rows in np.split(order, starts):
        mask[rows] = _longest_rising(time[rows])
    return mask


def _longest_rising(time: FloatArray) -> BoolArray:
    """Mask of a longest strictly increasing subsequence (patience sorting; the first of equals)."""
    if np.isfinite(time).all() and np.all(np.diff(time) > 0):
        return np.ones(len(time), dtype=np.bool_)
    tails: list[float] = []  # smallest last time of a rising subsequence of each length
    last: list[int] = []  # where that time is
    previous = np.full(len(time), -1)
    for i, t in enumerate(time.tolist()):
        k = bisect_left(tails, t)
        if not isfinite(t) or (k < len(tails) and tails[k] == t):
            continue
        previous[i] = last[k - 1] if k else -1
        tails[k : k + 1] = [t]
        last[k : k + 1] = [i]
    mask = np.zeros(len(time), dtype=np.bool_)
    i = last[-1] if last else -1
    while i >= 0:
        mask[i] = True
        i = int(previous[i])
    return mask


def by_stamp(stamp: FloatArray) -> IntArray:
    """Order `(n,)` that sorts the stamps of messages received out of order; the order they have where it is not that.

    After a clock was set back, stamps lie between those of an earlier stretch: once sorted, they stand too close.

    Parameters
    ----------
    stamp : (n,) array, by the source's clock, in the order of reception, s
    """
    order, received = np.argsort(stamp, kind="stable"), np.arange(len(stamp))
    moved = order != received
    if not moved.any():
        return received
    ordered = stamp[order]
    spans = (ordered[2:] - ordered[:-2])[moved[2:] | moved[1:-1] | moved[:-2]]
    late = np.max(np.maximum.accumulate(stamp) - stamp)
    sound = late <= LATEST * np.ptp(stamp) and np.all(spans > CLOSEST * np.median(np.diff(ordered)))
    return order if sound else received


def _past_midnight(time: FloatArray) -> tuple[FloatArray, list[str]]:
    """Let a time of day run on past midnight, where it falls by a day but for a usual step; and remark on it."""
    with np.errstate(invalid="ignore"):
        steps = np.diff(time)
    forward = steps[steps > 0]
    midnight = np.abs(steps + DAY) <= GAP_STEPS * np.median(forward) if forward.size else steps > 0
    if not midnight.any():
        return time, []
    remark = "time falls by 86400 s from one sample to the next: a time of day, which runs on past midnight here."
    return time + DAY * np.concatenate([[0], np.cumsum(midnight)]), [remark]


def check_order(
    time: FloatArray, group: IntArray, disorder: Disorder, locate: Callable[[int], str]
) -> tuple[FloatArray, BoolArray, list[str]]:
    """Time that runs on past midnight, rows to keep under a rule about disorder, and remarks where it had to act.

    Parameters
    ----------
    time, group : (n,) arrays, see :func:`rising`
    disorder : {"refuse", "drop", "keep"}
        Raise; leave the disordered samples out; or keep everything, for looking at a recording.
    locate : callable, names a row for messages, such as "line 12"
    """
    time, remarks = _past_midnight(time)
    ordered = rising(time, group)
    wrong = np.flatnonzero(~ordered)
    if not wrong.size:
        return time, ordered, remarks
    first = int(wrong[0])
    what = f"({time[first]:.9g} s) is out of order" if isfinite(time[first]) else "is missing"
    more = f" ({wrong.size} such samples)" if wrong.size > 1 else ""
    found = f"time at {locate(first)} {what} inside trajectory {group[first]}{more}"
    if disorder == "refuse":
        hint = f"Time must increase: give each motion its own trajectory number, or {LEAVE_OUT}."
        raise LogError(f"{found}.", hint=hint)
    if disorder == "keep":
        return time, np.ones_like(ordered), [*remarks, f"{found}; left in."]
    return time, ordered, [*remarks, f"{found}; left out."]
