"""Least median of squares: breakdown, equivariance, consistency, and the refusal of what it cannot fit."""

from __future__ import annotations

import numpy as np
import pytest
from cleaning_synthetic import World, make_log
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcorrect import se3
from gpcorrect.cleaning.least_median import LeastMedian, least_median_plane, least_median_pose
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import fit_pose
from gpcorrect.robust import robust_scale
from gpcorrect.types import FloatArray, IntArray, PoseSignal

SLOPES = np.array([2.0, -1.0, 0.5])
RESOLUTION = np.array([1e-4, 1e-3])


def plane_data(share: float, clustered: bool) -> tuple[FloatArray, FloatArray]:
    """Draw samples of the plane `x . SLOPES + 3` with noise 0.01, a share of which is wrong by hundreds."""
    rng = np.random.default_rng(0)
    X = rng.normal(size=(200, 3))
    y = X @ SLOPES + 3 + 0.01 * rng.normal(size=200)
    bad = rng.choice(200, round(share * 200), replace=False)
    if clustered:
        X[bad] = np.array([10.0, 10.0, 10.0]) + 0.01 * rng.normal(size=(len(bad), 3))
        y[bad] = 500.0
    else:
        y[bad] += rng.choice([-1, 1], len(bad)) * rng.uniform(5, 500, len(bad))
    return X, y[:, None]


def poses(world: World, seed: int = 0) -> tuple[PoseSignal, PoseSignal]:
    """Return observed and commanded poses of a log without faults."""
    log = make_log(world, np.random.default_rng(seed))
    assert log.tracker_cp is not None
    assert log.setpoint_cp is not None
    return log.tracker_cp, log.setpoint_cp


@pytest.mark.parametrize("clustered", [False, True])
def test_almost_half_of_the_data_may_be_wrong(clustered: bool) -> None:
    """With 45 % outliers, scattered or all in one leverage point, the plane is that of the others."""
    plane, scales = least_median_plane(*plane_data(0.45, clustered), np.random.default_rng(0))
    np.testing.assert_allclose(plane[:, 0], [*SLOPES, 3], atol=0.01)
    assert scales[0] < 0.03


def test_least_squares_breaks_where_least_median_does_not() -> None:
    """The planted outliers are hard enough: ordinary least squares misses the slopes by far."""
    X, y = plane_data(0.45, clustered=True)
    ordinary = np.linalg.lstsq(np.hstack([X, np.ones((200, 1))]), y, rcond=None)[0]
    assert np.abs(ordinary[:3, 0] - SLOPES).max() > 1


@pytest.mark.parametrize("clustered", [False, True])
def test_almost_half_of_the_poses_may_be_wrong(clustered: bool) -> None:
    """With 45 % of observed poses moved, each by itself or all alike, the registration is that of the others."""
    observed, command = poses(World(reaches=10, field_m=0, field_rad=0, viscous_s=0, play_m=0, play_rad=0))
    truth = fit_pose(observed, command, rotation_weight=1e-3)
    rng = np.random.default_rng(1)
    bad = rng.choice(len(observed), round(0.45 * len(observed)), replace=False)
    position = np.array(observed.position)
    position[bad] += np.array([0.2, 0.1, 0.0]) if clustered else rng.uniform(-0.3, 0.3, (len(bad), 3))
    moved = PoseSignal(position, observed.quaternion)
    found = least_median_pose(moved, command, RESOLUTION, np.random.default_rng(2))[0]
    difference = found.apply(observed).position - truth.apply(observed).position
    assert np.linalg.norm(difference, axis=1).max() < 5e-4


def test_a_change_of_tracker_frame_changes_nothing() -> None:
    """Registration is equivariant: observed poses in another frame are mapped to the same poses, at the same scale."""
    observed, command = poses(World(reaches=10))
    assert observed.quaternion is not None
    R = se3.matrix_from_rotvec(np.array([0.3, -1.0, 2.0]))
    turned = se3.quaternion_from_matrix(R @ se3.matrix_from_quaternion(observed.quaternion))
    other = PoseSignal(observed.position @ R.T + np.array([5.0, 0.0, -1.0]), turned)
    first, second = (
        least_median_pose(seen, command, RESOLUTION, np.random.default_rng(3)) for seen in (observed, other)
    )
    np.testing.assert_allclose(first[0].apply(observed).position, second[0].apply(other).position, atol=1e-9)
    np.testing.assert_allclose(first[1], second[1], rtol=1e-9)


@settings(max_examples=10, deadline=None)
@given(shift=st.floats(-10, 10), factor=st.floats(0.1, 10), tilt=st.floats(-5, 5))
def test_the_plane_follows_its_data(shift: float, factor: float, tilt: float) -> None:
    """Outputs that are scaled, tilted and shifted give the scaled, tilted and shifted plane."""
    X, y = plane_data(0.3, clustered=False)
    tilted = factor * y + tilt * X[:, :1] + shift
    plane, moved = (least_median_plane(X, v, np.random.default_rng(1))[0] for v in (y, tilted))
    np.testing.assert_allclose(moved, factor * plane + np.array([[tilt], [0], [0], [shift]]), atol=1e-6)


@pytest.mark.parametrize("dimension", [1, 3])
def test_the_robust_scale_is_the_standard_deviation_of_gaussian_noise(dimension: int) -> None:
    """On Gaussian residuals the robust scale agrees with the standard deviation of a component."""
    noise = 0.2 * np.random.default_rng(0).normal(size=(20000, dimension))
    assert float(robust_scale(np.linalg.norm(noise, axis=1), dimension)) == pytest.approx(0.2, rel=0.02)


def test_too_few_rows_are_refused() -> None:
    """Fewer rows than a sample needs raise an error that says both numbers."""
    with pytest.raises(DataError, match="at least 4 samples, got 3"):
        LeastMedian(np.mean, lambda m: np.ones((3, 1)), 3, sample_size=4).search(np.random.default_rng(0))


def test_rows_that_never_determine_a_model_are_refused() -> None:
    """Where every random sample is degenerate, so is the whole, for the reason that the fit gave."""

    def fit(rows: IntArray) -> float:
        raise DegenerateError("all points coincide.")

    with pytest.raises(DegenerateError, match="all points coincide"):
        LeastMedian(fit, lambda m: np.ones((9, 1)), 9, sample_size=4).search(np.random.default_rng(0))
