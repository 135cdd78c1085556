"""Laws of the offset's confidence interval: it holds the truth as often as it says."""

from __future__ import annotations

import numpy as np
import pytest
from sync_support import Recording, wandering

from gpcorrect.logs.sync import estimate_offset
from gpcorrect.logs.sync.refine import lost_freedom


@pytest.mark.parametrize(
    "recording",
    [
        Recording(),
        Recording(seconds=20.0, outliers=0.05, jitter=0.4),
        Recording(correlation=0.9),
        Recording(seconds=12.0, noise=1e-3),
    ],
    ids=["white", "outliers", "correlated", "noisy"],
)
def test_interval_covers_the_truth(recording):
    """The 95 % interval holds the planted offset in 95 % of 60 recordings, within three standard errors."""
    hits = []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        offset = rng.uniform(-0.8, 0.8)
        found = estimate_offset([recording.pair(wandering(rng), offset, rng)])
        assert found.observable, found.reason
        hits.append(found.ci95[0] <= offset <= found.ci95[1])
    assert np.mean(hits) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / 60)


def test_interval_narrows_with_noise_and_length():
    """Ten times the noise is about ten times the interval; four times the length about half of it."""
    widths = {}
    for name, recording in {
        "base": Recording(),
        "noisy": Recording(noise=1.5e-3),
        "long": Recording(seconds=120.0),
    }.items():
        found = []
        for seed in range(6):
            rng = np.random.default_rng(seed)
            found.append(np.ptp(estimate_offset([recording.pair(wandering(rng), 0.1, rng)]).ci95))
        widths[name] = np.median(found)
    assert 6 < widths["noisy"] / widths["base"] < 14
    assert 0.3 < widths["long"] / widths["base"] < 0.8


def test_fitted_unknowns_cost_slow_noise_more():
    """White residuals of 1000 samples hardly miss four unknowns; correlated ones miss them more."""
    rng = np.random.default_rng(2)
    white = rng.normal(size=(1000, 1))
    slow = np.cumsum(white, axis=0)
    assert 1.0 < lost_freedom(white, 4) < 1.02
    assert lost_freedom(slow, 4) > 1.2
