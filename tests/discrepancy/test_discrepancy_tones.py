"""Tones: found where they are, silent in noise of any smooth spectrum, and part of what a run finds."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy_support import outside
from scipy.signal import lfilter

from gpcorrect.discrepancy.evidence.localise import ChannelData, localise, strongest_tone
from gpcorrect.discrepancy.evidence.variables import Covariates, Quantity, Variable, all_cells
from gpcorrect.discrepancy.recording.noise import estimate_noise
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.types import FloatArray, IntArray

RUNS, ROWS, STEP = 19, 375, 0.06

Recording = tuple[FloatArray, FloatArray, IntArray]

SESSION_TIME = Variable(Quantity.SESSION_TIME)


def recording(
    seed: int, size: float = 0.0, frequency: float = 3.3, phi: float = 0.0, tail: float = np.inf, jitter: float = 0.0
) -> Recording:
    """Noise of unit variance, half of it slow where phi is not zero, and a tone that runs on between trajectories."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(RUNS), ROWS)
    time = np.arange(len(block)) * STEP + 1.7 * block + jitter * STEP * rng.uniform(-0.5, 0.5, len(block))
    noise = rng.standard_normal(len(block)) if np.isinf(tail) else rng.standard_t(tail, len(block))
    if phi:
        slow = lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal((RUNS, ROWS)), axis=1).ravel()
        noise = (noise + slow) / np.sqrt(2)
    return time, noise + size * np.sqrt(2) * np.sin(2 * np.pi * frequency * time), block


@pytest.mark.parametrize("phi", [0.0, 0.8, 0.95, 0.999])
def test_noise_of_a_smooth_spectrum_has_no_tone(phi: float) -> None:
    tones = [strongest_tone(*recording(seed, phi=phi)) for seed in range(6)]
    assert max(t.nats for t in tones if t is not None) < SETTINGS.tests.sure_tone


def test_heavy_tails_are_no_tone() -> None:
    tones = [strongest_tone(*recording(seed, tail=2.5)) for seed in range(6)]
    assert max(t.nats for t in tones if t is not None) < SETTINGS.tests.sure_tone


@pytest.mark.parametrize("frequency", [0.6, 1.0, 3.3, 7.5])
@pytest.mark.parametrize("jitter", [0.0, 0.8])
def test_a_tone_is_found_at_its_frequency_and_of_its_size(frequency: float, jitter: float) -> None:
    """Whether samples come evenly or not, and in slow noise."""
    tone = strongest_tone(*recording(1, 0.5, frequency, phi=0.8, jitter=jitter))
    assert tone is not None
    assert tone.nats > SETTINGS.tests.sure_tone
    assert tone.low < frequency < tone.high
    assert tone.rms == pytest.approx(0.5, rel=0.2)


def test_missing_samples_are_left_out() -> None:
    time, values, block = recording(2, 0.5)
    values[::7] = np.nan
    values[block == 3] = np.nan
    tone = strongest_tone(time, values, np.where(block == 4, -1, block))
    assert tone is not None
    assert tone.low < 3.3 < tone.high


def test_one_long_trajectory_will_do() -> None:
    time, values, _ = recording(3, 0.5)
    tone = strongest_tone(time, values, np.zeros(len(time), dtype=np.int64))
    assert tone is not None
    assert tone.low < 3.3 < tone.high


def test_a_short_recording_says_nothing() -> None:
    time, values, block = recording(4, 1.0)
    assert strongest_tone(time[:700], values[:700], block[:700]) is None


def localised(size: float) -> tuple[list[tuple[Variable, ...]], bool]:
    time, values, block = recording(5, size)
    noise = estimate_noise(time, values, block, np.zeros(len(time), dtype=np.bool_))
    tests = all_cells(Covariates({SESSION_TIME: time}, (SESSION_TIME,)))
    result = localise([ChannelData(outside(1), time, values, block, noise, tests)], np.random.default_rng(0))
    return [tuple(s.variable for s in f.region) for f in result.findings], result.nothing


def test_a_tone_that_matters_is_a_finding() -> None:
    """One as large as the noise is; one of a tenth of it does not matter."""
    assert localised(1.0) == ([(Variable(Quantity.FREQUENCY),)], False)
    assert localised(0.1) == ([], True)
