"""What is outside the catalogue is not a catalogue effect by another name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from truth import OUTSIDE, Spec
from truth.case import Truth, make_truth

MOST = 0.7  # share of a trace that one signature of the catalogue may explain


def _signatures(truth: Truth, j: int) -> Iterator[list[np.ndarray]]:
    """Yield columns that one effect on joint j may add up: geometry, load, friction, time, stops."""
    reference, motion = truth.setting.reference, truth.setting.history.motion
    rows = reference.logged
    q, load, speed = truth.setting.readings.outside[rows], motion.load[rows, j], motion.speed[rows, j]
    x, time, forth = np.ptp(q[:, j]), reference.session_time[rows], np.sign(speed)
    yield from ([q[:, k]] for k in range(3))
    yield from ([load], [load, load**3], [load, load * q[:, 2]], [motion.weight[rows, j]], [time], [speed])
    yield from ([forth], [forth, np.abs(load) * forth])
    for n in np.linspace(1.0, 60.0, 80):
        wave = [np.sin(n * q[:, j] / x), np.cos(n * q[:, j] / x)]
        yield wave
        yield [forth, *(w * forth for w in wave)]
    yield from ([(time > t) * 1.0] for t in np.quantile(time, np.linspace(0.1, 0.9, 9)))
    yield from ([np.maximum(0.0, q[:, j] - p)] for p in np.quantile(q[:, j], (0.1, 0.5, 0.9)))


def _explained(trace: np.ndarray, columns: list[np.ndarray]) -> float:
    A = np.column_stack([np.ones(len(trace)), *columns])
    rest = trace - A @ np.linalg.lstsq(A, trace, rcond=None)[0]
    return float(1.0 - np.sum(rest**2) / np.sum((trace - trace.mean()) ** 2))


@pytest.mark.parametrize("name", [n for n, kind in OUTSIDE.items() if not kind.tracker_only])
def test_no_single_effect_explains_what_is_outside(name: str) -> None:
    """The best signature of the catalogue leaves a good part of the trace."""
    truth = make_truth(Spec("outside", (name,), 2.0, trajectories=4, seconds=8.0), 1)
    j = truth.case.labels["effects"][0]["joint"] - 1
    rows = truth.setting.reference.logged
    trace = (truth.readings.outside - truth.setting.readings.outside)[rows, j]
    assert max(_explained(trace, s) for s in _signatures(truth, j)) < MOST
