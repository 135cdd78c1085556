"""Laws of honesty: where the motion does not determine the offset, that is the answer; intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from sync_support import Recording, sines, wandering

from gpcorrect.logs.sync import Motion, MotionPair, estimate_offset
from gpcorrect.logs.sync.refine import lost_freedom


def still(t):
    return np.zeros((len(t), 3))


def line(t):
    return np.outer(t, [0.005, 0.001, 0.0])


def ellipse(t):
    return sines((0.05, 0.02, 0.0), (4.0, 4.0, 0.0), np.pi / 2)(t)


def circle(t):
    return sines((0.05, 0.05, 0.0), (2.0, 2.0, 0.0), np.pi / 2)(t)


def stroke(t):
    return sines((0.05, 0.0, 0.0), (6.0, 0.0, 0.0))(t)


@pytest.mark.parametrize(
    ("path", "verdict"),
    [(still, "still"), (line, "steady"), (circle, "steady"), (ellipse, "steady"), (stroke, "ambiguous")],
    ids=["rest", "line", "circle", "ellipse", "sine"],
)
@pytest.mark.parametrize("noise", [0.0, 1.5e-4])
def test_motion_without_a_clock_gives_a_verdict(path, verdict, noise):
    """Rest, steady motion and repetition give a verdict and a reason in place of an offset."""
    rng = np.random.default_rng(0)
    found = estimate_offset([Recording(noise=noise).pair(path, 0.23, rng)])
    assert not found.observable
    assert found.verdict == verdict
    assert found.reason


def test_repeating_motion_names_its_rivals():
    """Strokes of period T leave the offset open up to T/2: rivals are so far apart, one is the truth."""
    rng = np.random.default_rng(1)
    found = estimate_offset([Recording().pair(stroke, 0.23, rng)])
    all_offsets = np.sort([found.offset, *found.rivals])
    assert np.abs(all_offsets - 0.23).min() < 1e-3
    np.testing.assert_allclose(np.diff(all_offsets), np.pi / 6, atol=2e-3)
    assert abs(found.offset) == np.abs(all_offsets).min()


def test_a_start_ends_the_ambiguity():
    """The same strokes after two seconds of rest are observable: the start happens once."""

    def path(t):
        return np.where(t[:, None] < 5.0, stroke(np.full_like(t, 5.0)), stroke(t))

    rng = np.random.default_rng(2)
    assert estimate_offset([Recording(seconds=12.0).pair(path, 0.23, rng)]).offset == pytest.approx(0.23, abs=2e-3)


def test_another_motion_is_not_matched():
    """The tracker of one motion beside the command of another is unrelated at every lag."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        one = Recording().pair(wandering(rng), 0.0, rng)
        other = Recording().pair(wandering(rng), 0.0, rng)
        found = estimate_offset([MotionPair(one.reference, other.observed)])
        assert not found.observable


def test_a_dead_tracker_is_not_matched():
    """A tracker that only shows noise is unrelated to any command."""
    rng = np.random.default_rng(3)
    one = Recording().pair(wandering(rng), 0.0, rng)
    noise = Motion(one.observed.time, 1e-4 * rng.normal(size=one.observed.values.shape))
    assert estimate_offset([MotionPair(one.reference, noise)]).verdict == "unrelated"


def test_nothing_in_common_is_reported():
    """No samples, no shared time, or a handful of samples give a verdict, not an exception."""
    rng = np.random.default_rng(4)
    pair = Recording().pair(wandering(rng), 0.0, rng)
    apart = MotionPair(pair.reference, Motion(pair.observed.time + 1e6, pair.observed.values))
    few = MotionPair(pair.reference.rows(pair.reference.time < 0.05), pair.observed.rows(pair.observed.time < 0.05))
    empty = Motion(np.empty(0), np.empty((0, 3)))
    for pairs in ([], [apart], [few], [MotionPair(empty, empty)], [MotionPair(pair.reference, empty)]):
        found = estimate_offset(pairs)
        assert not found.observable
        assert np.isnan(found.offset)


def test_the_curve_peaks_at_the_offset():
    """The pooled correlation, for a plot, has its maximum within a grid step of the offset."""
    rng = np.random.default_rng(5)
    found = estimate_offset([Recording().pair(wandering(rng), -0.4, rng)])
    top = found.lags[np.nanargmax(found.correlation)]
    assert abs(top + 0.4) < 2 * (found.lags[1] - found.lags[0])
    assert np.nanmax(found.correlation) > 0.95


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
