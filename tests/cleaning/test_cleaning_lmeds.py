"""Least median of squares: breakdown, equivariance, consistency, and the estimator's manners."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cleaning_synthetic import World, make_log, register
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.utils.estimator_checks import check_estimator

from gpcorrect import se3
from gpcorrect.cleaning.lmeds import least_median, robust_scale, trials_needed
from gpcorrect.cleaning.regressor import LeastMedianOfSquares
from gpcorrect.cleaning.robust_rigid import fit_rigid_robustly
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray

SLOPES = np.array([2.0, -1.0, 0.5])
RESOLUTION = np.array([1e-4, 1e-3])


def plane_data(share: float, clustered: bool, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Draw samples of the plane `x . SLOPES + 3` with noise 0.01, a share of which is wrong by hundreds."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(200, 3))
    y = X @ SLOPES + 3 + 0.01 * rng.normal(size=200)
    bad = rng.choice(200, round(share * 200), replace=False)
    if clustered:
        X[bad] = np.array([10.0, 10.0, 10.0]) + 0.01 * rng.normal(size=(len(bad), 3))
        y[bad] = 500.0
    else:
        y[bad] += rng.choice([-1, 1], len(bad)) * rng.uniform(5, 500, len(bad))
    return X, y


@pytest.mark.parametrize("clustered", [False, True])
def test_almost_half_of_the_data_may_be_wrong(clustered: bool) -> None:
    """With 45 % outliers, scattered or all in one leverage point, the plane is that of the others."""
    X, y = plane_data(0.45, clustered)
    plane = LeastMedianOfSquares(random_state=0).fit(X, y)
    np.testing.assert_allclose(plane.coef_, SLOPES, atol=0.01)
    assert plane.intercept_ == pytest.approx(3, abs=0.01)
    assert plane.scale_ < 0.03


def test_least_squares_breaks_where_least_median_does_not() -> None:
    """The planted outliers are hard enough: ordinary least squares misses the slopes by far."""
    X, y = plane_data(0.45, clustered=True)
    ordinary = np.linalg.lstsq(np.hstack([X, np.ones((200, 1))]), y, rcond=None)[0]
    assert np.abs(ordinary[:3] - SLOPES).max() > 1


@pytest.mark.parametrize("clustered", [False, True])
def test_almost_half_of_the_poses_may_be_wrong(clustered: bool) -> None:
    """With 45 % of observed poses moved, each by itself or all alike, the registration is that of the others."""
    log = make_log(
        World(reaches=10, field_m=0, field_rad=0, viscous_s=0, play_m=0, play_rad=0), np.random.default_rng(0)
    )
    observed, command = log.tracker_cp, log.setpoint_cp
    assert observed is not None
    assert command is not None
    truth = register(observed, command)
    rng = np.random.default_rng(1)
    bad = rng.choice(len(log), round(0.45 * len(log)), replace=False)
    position = np.array(observed.position)
    position[bad] += np.array([0.2, 0.1, 0.0]) if clustered else rng.uniform(-0.3, 0.3, (len(bad), 3))
    moved = type(observed)(position, observed.quaternion)
    found = fit_rigid_robustly(moved, command, register, RESOLUTION, np.random.default_rng(2)).model
    difference = found.apply(observed).position - truth.apply(observed).position
    assert np.linalg.norm(difference, axis=1).max() < 5e-4


def test_a_change_of_tracker_frame_changes_nothing() -> None:
    """Registration is equivariant: observed poses in another frame are mapped to the same poses, at the same scale."""
    log = make_log(World(reaches=10), np.random.default_rng(0))
    observed, command = log.tracker_cp, log.setpoint_cp
    assert observed is not None
    assert observed.quaternion is not None
    assert command is not None
    R = se3.matrix_from_rotvec(np.array([0.3, -1.0, 2.0]))
    turned = se3.quaternion_from_matrix(R @ se3.matrix_from_quaternion(observed.quaternion))
    other = type(observed)(observed.position @ R.T + np.array([5.0, 0.0, -1.0]), turned)
    first, second = (
        fit_rigid_robustly(seen, command, register, RESOLUTION, np.random.default_rng(3)) for seen in (observed, other)
    )
    np.testing.assert_allclose(first.model.apply(observed).position, second.model.apply(other).position, atol=1e-9)
    np.testing.assert_allclose(first.scales, second.scales, rtol=1e-9)


@settings(max_examples=10, deadline=None)
@given(shift=st.floats(-10, 10), factor=st.floats(0.1, 10), tilt=st.floats(-5, 5))
def test_the_plane_follows_its_data(shift: float, factor: float, tilt: float) -> None:
    """Outputs that are scaled, tilted and shifted give the scaled, tilted and shifted plane."""
    X, y = plane_data(0.3, clustered=False)
    tilted = factor * y + tilt * X[:, 0] + shift
    plane, moved = (LeastMedianOfSquares(random_state=1).fit(X, v) for v in (y, tilted))
    np.testing.assert_allclose(moved.coef_, factor * plane.coef_ + [tilt, 0, 0], atol=1e-6)
    assert moved.intercept_ == pytest.approx(factor * plane.intercept_ + shift, abs=1e-6)


def test_the_same_seed_gives_the_same_plane() -> None:
    """Two fits with one random state agree in every digit."""
    X, y = plane_data(0.4, clustered=False)
    first, second = (LeastMedianOfSquares(random_state=4).fit(X, y) for _ in range(2))
    np.testing.assert_array_equal(first.coef_, second.coef_)


@pytest.mark.parametrize("dimension", [1, 3])
def test_the_robust_scale_is_the_standard_deviation_of_gaussian_noise(dimension: int) -> None:
    """On Gaussian residuals the robust scale agrees with the standard deviation of a component."""
    noise = 0.2 * np.random.default_rng(0).normal(size=(20000, dimension))
    assert float(robust_scale(np.linalg.norm(noise, axis=1), dimension)) == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("size", [1, 3, 6])
def test_enough_samples_are_drawn(size: int) -> None:
    """So many random samples of half-wrong data all hold an outlier at a chance of 0.001, and one less does not do."""
    missed = 1 - 0.5**size
    assert missed ** trials_needed(size) <= 1e-3 * (1 + 1e-9)
    assert math.isclose(missed ** (trials_needed(size) - 1), 1e-3) or missed ** (trials_needed(size) - 1) > 1e-3


def test_too_few_rows_are_refused() -> None:
    """Fewer rows than a sample needs raise an error that says both numbers."""
    with pytest.raises(DataError, match="at least 4 samples, got 3"):
        least_median(np.mean, lambda m: np.ones((3, 1)), 3, sample_size=4, rng=np.random.default_rng(0))


def test_rows_that_never_determine_a_model_are_refused() -> None:
    """Where every random sample is degenerate, so is the whole, for the reason that the fit gave."""

    def fit(rows: IntArray) -> float:
        raise DegenerateError("all points coincide.")

    with pytest.raises(DegenerateError, match="all points coincide"):
        least_median(fit, lambda m: np.ones((9, 1)), 9, sample_size=4, rng=np.random.default_rng(0))


@pytest.mark.slow
def test_the_estimator_keeps_the_conventions_of_scikit_learn() -> None:
    """Scikit-learn's own checks of an estimator pass."""
    check_estimator(LeastMedianOfSquares())
