"""Noise: what is estimated is what was drawn, motion is not taken for it, and whitening whitens."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gpcorrect.discrepancy.recording.noise import ChannelNoise, NoiseSource, Whitener, estimate_noise, outliers
from gpcorrect.types import FloatArray, IntArray

STEP, CORRELATION = 0.05, 0.3


def drawn(
    seed: int, white: float, slow: float, blocks: int = 20, rows: int = 400
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return time, white plus first-order autoregressive noise, and block."""
    rng = np.random.default_rng(seed)
    phi = np.exp(-STEP / CORRELATION)
    shocks = rng.standard_normal((blocks, rows)) * np.sqrt(1 - phi**2)
    shocks[:, 0] /= np.sqrt(1 - phi**2)
    r = white * rng.standard_normal((blocks, rows)) + slow * lfilter([1.0], [1.0, -phi], shocks, axis=1)
    block = np.repeat(np.arange(blocks), rows)
    return np.arange(blocks * rows) * STEP + 10.0 * block, r.ravel(), block


def test_the_drawn_noise_is_estimated() -> None:
    """White and slow part and their sum come out within a fifth."""
    time, r, block = drawn(0, 1e-3, 8e-4)
    noise = estimate_noise(time, r, block, np.zeros(len(r), dtype=np.bool_))
    assert noise.std == pytest.approx(np.hypot(1e-3, 8e-4), rel=0.2)
    assert noise.white == pytest.approx(1e-3, rel=0.2)


def test_smooth_motion_is_not_noise() -> None:
    """An effect five times the noise that follows the motion raises the estimate by less than a third."""
    time, r, block = drawn(1, 1e-3, 0.0)
    noise = estimate_noise(time, r + 5e-3 * np.sin(2 * time), block, np.zeros(len(r), dtype=np.bool_))
    assert noise.white < 1.33e-3


def test_whitening_leaves_independent_noise_of_unit_size() -> None:
    """Innovations have variance one and no correlation with the one before."""
    time, r, block = drawn(2, 1e-3, 1e-3)
    z = Whitener.of(ChannelNoise(1e-3, 1e-3, CORRELATION), time, block)(r[:, None])[:, 0]
    assert np.var(z) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(z[1:], z[:-1])[0, 1] == pytest.approx(0.0, abs=0.04)


def test_whitening_is_linear_and_starts_afresh_in_every_block() -> None:
    """The whitened sum is the sum of the whitened; another block's values do not reach into a block."""
    time, r, block = drawn(3, 1e-3, 1e-3, blocks=2)
    whitener = Whitener.of(ChannelNoise(1e-3, 1e-3, CORRELATION), time, block)
    other = np.where(block == 0, 1.0, 0.0)
    a, b, both = (whitener(x[:, None])[:, 0] for x in (r, other, r + other))
    np.testing.assert_allclose(both, a + b, rtol=0, atol=1e-7 * np.abs(b).max())
    assert not b[block == 1].any()


def test_only_spikes_are_outliers() -> None:
    """Planted single jumps are found; a step, which belongs to the machine, is not."""
    _, r, block = drawn(4, 1e-3, 0.0)
    planted = np.arange(50, len(r), 997)
    r[planted] += 0.05
    r[len(r) // 2 + 200 :] += 0.02
    found = np.flatnonzero(outliers(r, block))
    assert set(planted) <= set(found)
    assert len(found) < len(planted) + 0.002 * len(r)


def test_a_single_spike_is_a_fault_and_a_burst_is_not() -> None:
    """What lasts longer than a fault of a sensor is the machine's doing, and stays."""
    residual = 1e-3 * np.random.default_rng(5).standard_normal(400)
    residual[50] += 0.1
    residual[200:205] += 0.1
    found = outliers(residual, np.zeros(400, dtype=np.int64))
    assert found[50]
    assert not found[200:205].any()


@pytest.mark.parametrize("offsets", [0.0, 3.0])
def test_noise_of_holds_is_known_well_whatever_is_constant_in_them(offsets: float) -> None:
    """The power of slow noise at low frequencies, by which evidence for offsets is counted, within a third."""
    rng, holds, rows, step, tau = np.random.default_rng(4), 60, 40, 0.05, 0.2
    phi = np.exp(-step / tau)
    block = np.repeat(np.arange(holds), rows)
    drive = rng.standard_normal((holds, rows)) * np.sqrt(1 - phi**2)
    drive[:, 0] /= np.sqrt(1 - phi**2)
    slow = lfilter([1.0], [1.0, -phi], drive, axis=1).ravel()
    time = np.tile(np.arange(rows) * step, holds) + 10.0 * block
    residual = 0.5 * rng.standard_t(6, len(block)) + slow + offsets * rng.standard_normal(holds)[block]
    noise = estimate_noise(time, residual, block, np.ones(len(block), dtype=np.bool_))
    assert noise.slow**2 * noise.time_constant == pytest.approx(tau, rel=0.33)
    assert noise.source == NoiseSource.HOLDS
