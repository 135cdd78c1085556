"""Table errors within the tolerance are nobody's effect; larger ones still are."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import raven2
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.tolerance import slack_of, table_slopes
from gpcorrect.discrepancy.recording.tracker import Tracker


def test_noise_and_tolerance_together_become_white() -> None:
    """Seen through the slack, noise plus errors within the tolerance has the covariance of the noise alone."""
    rng = np.random.default_rng(0)
    slopes, sigma = rng.standard_normal((40, 2, 5)), 0.7
    rows = np.ones((40, 2), dtype=np.bool_)
    slack = slack_of(slopes, rows, (ChannelNoise(sigma, 0.0, 1.0),) * 2, 0.01)
    B = slopes.reshape(80, 5)
    W = np.eye(80) - B @ slack.pick
    np.testing.assert_allclose(W @ (sigma**2 * np.eye(80) + B @ B.T) @ W.T, sigma**2 * np.eye(80), atol=1e-9)


def test_what_is_taken_follows_the_rows_that_may_be_looked_at() -> None:
    """The sealed rows change nothing of what is taken, and get their fraction of it."""
    rng = np.random.default_rng(1)
    slopes, rows = rng.standard_normal((30, 3, 4)), np.ones((30, 3), dtype=np.bool_)
    rows[20:] = False
    slack = slack_of(slopes, rows, (ChannelNoise(0.1, 0.0, 1.0),) * 3, 0.01)
    residual = slopes @ np.ones(4)
    other = residual + 100.0 * (~rows)
    np.testing.assert_array_equal(slack.part(residual), slack.part(other))
    assert np.abs((residual - slack.part(residual))[20:]).max() < 0.2 * np.abs(residual[20:]).max()


def test_slopes_agree_with_a_tracker_that_is_turned() -> None:
    """In a turned tracker frame the slopes turn with it, and a registration takes up rigid motions entirely."""
    chain = raven2("left").chain
    rng = np.random.default_rng(2)
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (50, 6))
    tip = chain.forward(q)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    T = se3.pose(turn, np.ones(3))
    seen = tracker_of(T @ tip, base_known=False)
    np.testing.assert_allclose(seen.predicted(tip)[:, :3], (T @ tip)[:, :3, 3], atol=1e-12)
    plain, seen = (table_slopes(chain, q, S, tracker_of(S @ tip, base_known=True)) for S in (np.eye(4), T))
    rows = plain.shape[2] - 6  # the last six are the registration's own errors
    np.testing.assert_allclose(seen[:, :3], np.einsum("ij,njr->nir", turn, plain[:, :3]), atol=1e-9)
    free = table_slopes(chain, q, np.eye(4), tracker_of(tip, base_known=False))
    assert free.shape[2] == rows
    assert np.abs(free[..., 4 * 2]).max() > 1e-6  # an angle between axes is no rigid motion


def tracker_of(T: np.ndarray, *, base_known: bool) -> Tracker:
    return Tracker(T[:, :3, 3], np.ones(len(T), dtype=np.bool_), base_known=base_known, marker_known=base_known)
