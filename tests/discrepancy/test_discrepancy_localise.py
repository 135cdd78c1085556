"""Localisation: silent in noise, clear where a residual depends on something.

And honest about what it cannot exclude.
"""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy_support import outside

from gpcorrect.discrepancy.evidence.localise import ChannelData, Localisation, localise
from gpcorrect.discrepancy.evidence.variables import Covariates, Quantity, Variable, all_cells
from gpcorrect.discrepancy.recording.noise import estimate_noise
from gpcorrect.discrepancy.recording.scene import Channel

RUNS, ROWS, STEP, NOISE = 14, 300, 0.05, 1e-3
OUTSIDE, MOTOR = outside(1), Channel("measured_jp_1", "measured_jp", 0, 1, "rad")
POSITION_1, POSITION_2 = Variable(Quantity.POSITION, 1), Variable(Quantity.POSITION, 2)
DIRECTION_1, SESSION_TIME = Variable(Quantity.DIRECTION, 1), Variable(Quantity.SESSION_TIME)


def found(seed: int, size: float = 0.0, tail: float = np.inf, seen: Channel = OUTSIDE) -> Localisation:
    """Localise noise plus an effect of the first joint's position, of this size in units of the noise."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(RUNS), ROWS)
    time = np.arange(len(block)) * STEP + 5.0 * block
    rate, phase = rng.uniform(0.3, 2.0, (RUNS, 2)), rng.uniform(0, 6, (RUNS, 2))
    q = np.sin(rate[block] * time[:, None] + phase[block])
    white = rng.standard_normal(len(block)) if np.isinf(tail) else rng.standard_t(tail, len(block))
    r = NOISE * (white + size * q[:, 0] * np.sqrt(2))
    direction = np.sign(np.gradient(q[:, 0]))
    values = {POSITION_1: q[:, 0], POSITION_2: q[:, 1], DIRECTION_1: direction, SESSION_TIME: time}
    noise = estimate_noise(time, r, block, np.zeros(len(r), dtype=np.bool_))
    tests = all_cells(Covariates(values, (POSITION_1, DIRECTION_1)))
    channel = ChannelData(seen, time, r, block, noise, tests)
    return localise([channel], np.random.default_rng(seed + 99))


@pytest.mark.parametrize("tail", [np.inf, 3.0])
def test_noise_is_silent(tail: float) -> None:
    """In twelve sets of noise at most one test of many beats the 99 % law of their maximum."""
    assert sum(found(seed, tail=tail).something for seed in range(12)) <= 1


def test_a_small_effect_is_found_where_it_is() -> None:
    """A systematic part of a third of the noise is found, and the best test speaks of the right variable."""
    result = found(0, size=0.33)
    assert result.something
    assert POSITION_1 in [s.variable for s in result.findings[0].region]


def test_nothing_missing_needs_the_equivalence_too() -> None:
    """Noise alone is shown to be free of anything larger than a quarter of it.

    With an effect of half of it that is not shown.
    """
    assert found(1).nothing
    assert not found(1, size=0.5).nothing


@pytest.mark.parametrize(("size", "counts"), [(0.2, False), (0.4, True)])
def test_findings_below_the_least_size_do_not_count(size: float, counts: bool) -> None:
    """Of a servo's reported path thousands of samples show what does not matter; a name for it is looked for."""
    assert found(2, size=size).something
    result = found(2, size=size, seen=MOTOR)
    assert result.something == counts
    assert result.worth_a_search


def test_findings_know_their_size() -> None:
    """The best test of a sine of position takes nearly all of it."""
    assert found(3, size=0.5).findings[0].size == pytest.approx(0.5, rel=0.15)
