"""The delay of each joint by itself: one search for the delay of all joints together does not see that one is late."""

from __future__ import annotations

import numpy as np

from gpcorrect.logs.sync.motion import STILL, Motion, MotionPair, clock_runs
from gpcorrect.logs.sync.refine import Timing
from gpcorrect.types import CalibrationLog, FloatArray

MOST = 20_000  # samples of a part that are looked at: two minutes of a fast controller
LEAST_SECONDS = 15.0
"""Of each half of a recording: simulated joints with slack, recorded for 18 s, were called 130 and 280 ms late."""
BRACKET = 0.5  # s about the common delay, in which that of a joint is looked for
FOLLOWS = 0.99
"""Share of a joint's spread that the motors explain, below which slack or noise hide its delay: in the real recordings
0.999 and more at joints that move by more than they miss, 0.97 to 0.99 at wrists, whose delays are off by 0.2 s."""


def joint_delays(log: CalibrationLog, observed: str, reference: str, start: float) -> tuple[FloatArray, FloatArray]:
    """Return how far each joint is behind its motor, and half the width of the 95 % interval: `(2, d)` each, s.

    Of the first and of the second half of the recording, for a delay stays as it is. NaN where a joint does not show
    its own. Slack, and what other joints' motors do to it, are fitted beside it.

    Parameters
    ----------
    log : CalibrationLog, with a clock
    observed, reference : str, joint signals
    start : float, delay of all joints together, s
    """
    values, seen = getattr(log, reference), getattr(log, observed)
    joints = min(values.shape[1], seen.shape[1])
    delays, halves = np.full((2, 2, joints), np.nan)
    span = np.ptp(values[np.isfinite(values).all(axis=1)], axis=0)
    moving = np.flatnonzero(span > STILL * span.max(initial=0.0))
    for part, rows in enumerate(np.array_split(np.arange(len(log)), 2)):
        some = log.select(rows[:MOST])
        if sum(np.ptp(some.time[r]) for r in clock_runs(some)) < LEAST_SECONDS:
            continue
        q, y = (getattr(some, name)[:, moving] / span[moving] for name in (reference, observed))
        for k, joint in enumerate(moving[moving < joints]):
            known = y[np.isfinite(y[:, k]), k]
            if (known == known[:1]).all():  # missing, or dead
                continue
            pairs = [
                MotionPair(Motion(some.time[r], q[r]), Motion(some.time[r], y[r, k : k + 1])) for r in clock_runs(some)
            ]
            found = Timing(pairs).refine(np.array([start]), BRACKET)
            if found is not None and found.explained > FOLLOWS:
                delays[part, joint], halves[part, joint] = found.timing[0], found.half_width()[0]
    return delays, halves
