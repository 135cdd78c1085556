"""What remembers longer than one run: a lag that goes on from run to run of a session."""

from __future__ import annotations

from math import exp, expm1

import numpy as np

from gpcorrect.sim.effects.operators import lag
from gpcorrect.types import FloatArray, IntArray

__all__ = ["lag_through"]


def lag_through(path: FloatArray, time: FloatArray, session: IntArray, time_constant: float) -> FloatArray:
    """First-order lag `T x' + x = u` that goes on through the runs of a session.

    Between two runs, of which nothing is known, the input is taken as linear. The first run of a session starts in
    balance, and so does one that does not begin later than the one before it.

    Parameters
    ----------
    path : (n, N) array
        Input of N runs.
    time : (n, N) array
        Seconds since the session began, not falling within a run.
    session : (N,) int array
        Session of each run.
    time_constant : float
        T >= 0, s.

    Returns
    -------
    (n, N) array
        Output.

    Raises
    ------
    DataError
        The time constant is negative.
    """
    balanced = lag(path, time, time_constant)
    if time_constant == 0.0:
        return balanced
    away = np.zeros(path.shape[1])  # of each run's start from balance; fades within the run
    for before, run in _following(time, session):
        end = _row_at(time[:, before], time[0, run])
        last = balanced[end, before] + away[before] * exp((time[0, before] - time[end, before]) / time_constant)
        gap = time[0, run] - time[end, before]
        away[run] = _linear(last, path[end, before], path[0, run], gap, time_constant) - path[0, run]
    result: FloatArray = balanced + away * np.exp((time[0] - time) / time_constant)
    return result


def _following(time: FloatArray, session: IntArray) -> list[tuple[int, int]]:
    """Pairs of a run and the next one of the same session that begins later, in the order of time."""
    order = np.lexsort((time[0], session))
    pairs = zip(order[:-1].tolist(), order[1:].tolist(), strict=True)
    return [(a, b) for a, b in pairs if session[a] == session[b] and time[0, b] > time[0, a]]


def _row_at(clock: FloatArray, instant: float) -> int:
    """Last row of a run that is not after an instant: its end, unless the next run begins before that."""
    return max(int(np.searchsorted(clock, instant, side="right")) - 1, 0)


def _linear(state: float, first: float, last: float, seconds: float, time_constant: float) -> float:
    """Return the state after an input that went linearly from `first` to `last`."""
    if seconds <= 0.0:
        return state
    kept = exp(-seconds / time_constant)
    mean = -expm1(-seconds / time_constant) * time_constant / seconds
    return state * kept + first * (mean - kept) + last * (1.0 - mean)
