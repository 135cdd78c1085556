from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.gpr import FeatureMap
from gpcorrect.gpr.features import _fixed_axes_angles

POSE_VELOCITY = ("pose", "velocity")


def motion(n: int, seed: int, angle: float = 0.6):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    rotations = se3.matrix_from_rotvec(rng.uniform(-angle, angle, (n, 3)))
    return 0.05 * rng.normal(size=(n, 3)), rotations, 0.03 * rng.normal(size=(n, 6))


def turned(axis: int, degrees: np.ndarray) -> np.ndarray:
    return se3.matrix_from_rotvec(np.deg2rad(degrees)[:, None] * np.eye(3)[axis])


@given(axis=st.integers(0, 2), seed=st.integers(0, 1000))
def test_features_are_continuous_across_half_a_turn(axis: int, seed: int) -> None:
    """Around +-180 degrees about any axis neighbours have neighbouring features, as Euler angles have not."""
    positions, spread, twists = motion(60, seed)
    rotations = turned(axis, np.array([180.0]))[0] @ spread
    features = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists)
    path = turned(axis, np.linspace(170.0, 190.0, 201)) @ np.eye(3)
    X = features.transform(np.zeros((201, 3)), path)
    assert np.abs(np.diff(X, axis=0)).max() < 0.02
    angles = np.array([_fixed_axes_angles(R) for R in turned(2, np.array([179.9, 180.1]))])
    assert np.abs(np.diff(angles, axis=0)).max() > 6.0


@given(axis=st.integers(0, 2))
def test_features_of_wide_orientations_have_no_jump_anywhere(axis: int) -> None:
    """Training over all orientations takes columns of the matrix: a full turn is a closed smooth curve."""
    rng = np.random.default_rng(0)
    rotations = Rotation.random(200, rng=rng).as_matrix()
    features = FeatureMap(("pose",)).fit(rng.normal(size=(200, 3)), rotations, None)
    assert features.rotation == "columns"
    X = features.transform(np.zeros((721, 3)), turned(axis, np.linspace(0.0, 360.0, 721)))
    assert np.abs(np.diff(X, axis=0)).max() < 0.03
    np.testing.assert_allclose(X[0], X[-1], atol=1e-12)


def test_narrow_orientations_take_the_rotation_vector_from_the_mean() -> None:
    """Features are the log of R R_mean^T over the spread."""
    positions, rotations, twists = motion(100, 1)
    features = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists)
    assert features.rotation == "rotvec"
    expected = se3.rotvec_from_matrix(rotations @ se3.rotation_mean(rotations).T)
    np.testing.assert_allclose(
        features.transform(positions, rotations, twists)[:, 3:6] * features.spread[3:6], expected
    )


@pytest.mark.parametrize("kinds", [("pose",), POSE_VELOCITY, ("euler",), ("euler", "velocity")])
@pytest.mark.parametrize("angle", [0.6, 3.0])
@pytest.mark.parametrize("oriented", [True, False])
def test_every_column_belongs_to_one_group(kinds: tuple[str, ...], angle: float, oriented: bool) -> None:
    """The groups name each column of the features once, for every kind of feature."""
    positions, rotations, twists = motion(40, 2, angle)
    turns = rotations if oriented else None
    features = FeatureMap(kinds).fit(positions, turns, twists)
    named = [c for group in features.groups for c in group]
    assert features.transform(positions, turns, twists).shape[1] == features.n_features == len(named) == len(set(named))


def test_every_feature_that_varies_has_unit_spread_whatever_outliers_do() -> None:
    """Half the distance of the 16 % and 84 % quantiles is one, and one wild sample does not change that."""
    positions, rotations, twists = motion(2000, 3)
    twists[0] = 100.0
    features = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists)
    low, high = np.percentile(features.transform(positions, rotations, twists), (16, 84), axis=0)
    np.testing.assert_allclose((high - low) / 2, 1.0)


def test_a_feature_held_still_is_not_blown_up() -> None:
    """Micrometres of jitter in a height that never changes stay small beside real motion."""
    positions, rotations, twists = motion(200, 4)
    positions[:, 2] = 0.1 + 1e-6 * np.random.default_rng(0).normal(size=200)
    X = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists).transform(positions, rotations, twists)
    assert X[:, 2].std() < 0.02


def test_rows_without_a_velocity_are_not_usable_and_do_not_disturb_the_others() -> None:
    """A run of one sample has a NaN twist: its row is marked, the spread is learned without it."""
    positions, rotations, twists = motion(100, 5)
    twists[7] = np.nan
    features = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists)
    usable = np.isfinite(features.transform(positions, rotations, twists)).all(axis=1)
    assert not usable[7]
    assert usable.sum() == 99
    kept = usable.nonzero()[0]
    again = FeatureMap(POSE_VELOCITY).fit(positions[kept], rotations[kept], twists[kept])
    np.testing.assert_allclose(features.spread[6:], again.spread[6:])


def test_missing_rotations_are_not_usable_and_do_not_raise() -> None:
    """A dropped frame of the tracker is a row of NaN, not an exception."""
    positions, rotations, twists = motion(30, 6)
    rotations[3] = np.nan
    features = FeatureMap(("pose",)).fit(positions, rotations, twists)
    usable = np.isfinite(features.transform(positions, rotations, twists)).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(~usable), [3])


def test_no_twist_is_a_pose_at_rest() -> None:
    """Without a twist features are those of a zero twist."""
    positions, rotations, twists = motion(30, 7)
    features = FeatureMap(POSE_VELOCITY).fit(positions, rotations, twists)
    rest = features.transform(positions, rotations, np.zeros((30, 6)))
    np.testing.assert_array_equal(features.transform(positions, rotations), rest)


def test_position_only_data_give_linear_features() -> None:
    """Three positions and three linear velocities; the angular part of the twists may be NaN."""
    positions, _, twists = motion(50, 8)
    twists[:, 3:] = np.nan
    features = FeatureMap(POSE_VELOCITY).fit(positions, None, twists)
    assert not features.has_orientation
    assert features.transform(positions, None, twists).shape == (50, 6)
    assert features.groups == ((0, 1, 2), (3, 4, 5))


def test_a_spread_of_another_length_is_refused() -> None:
    """A damaged file does not become a map."""
    positions, rotations, twists = motion(60, 10)
    features = FeatureMap(("pose",)).fit(positions, rotations, twists)
    with pytest.raises(DataError, match="6 features"):
        replace(features, spread=np.ones(1))


@pytest.mark.parametrize("kinds", [(), ("velocity",), ("pose", "euler"), ("pose", "colour")])
def test_kinds_that_make_no_sense_are_refused(kinds: tuple[str, ...]) -> None:
    """Exactly one of pose and euler, and nothing unknown."""
    with pytest.raises(DataError, match="pose or euler"):
        FeatureMap(kinds)


def test_velocity_without_twists_and_too_few_samples_are_refused() -> None:
    """Fitting says what is missing."""
    positions, rotations, twists = motion(5, 11)
    with pytest.raises(DataError, match="no twists"):
        FeatureMap(POSE_VELOCITY).fit(positions, rotations, None)
    with pytest.raises(DataError, match="two complete samples"):
        FeatureMap(POSE_VELOCITY).fit(positions, rotations, np.full_like(twists, np.nan))


def test_euler_angles_rebuild_the_rotation() -> None:
    """R = Rz Ry Rx of the angles, as scipy has it."""
    rotations = Rotation.random(50, rng=np.random.default_rng(12)).as_matrix()
    np.testing.assert_allclose(
        Rotation.from_euler("xyz", _fixed_axes_angles(rotations)).as_matrix(), rotations, atol=1e-12
    )


def test_euler_features_do_not_jump_in_the_training() -> None:
    """Neighbouring rotations about half a turn have neighbouring features, though their angles pass +-180 degrees."""
    turn = np.pi + np.linspace(-0.5, 0.5, 101)
    rotations = se3.matrix_from_rotvec(turn[:, None] * np.array([1.0, 0.0, 0.0]))
    assert np.abs(np.diff(_fixed_axes_angles(rotations), axis=0)).max() > 6.0
    features = FeatureMap(("euler",)).fit(np.zeros((101, 3)), rotations, None)
    X = features.transform(np.zeros((101, 3)), rotations)
    steps = np.abs(np.diff(X * features.spread, axis=0))
    assert steps.max() < 0.011
