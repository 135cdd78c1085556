"""Zig-zags, their timing, and the other calibration motions."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.calibration import (
    DIRECTIONS,
    direction_named,
    random_sinusoids,
    random_sweeps,
    timed,
    zigzag,
)
from gpcorrect.calibration.excitation import Direction, _rotation_to
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

LIMITS = np.array([[0.35, 1.05], [0.96, 1.92], [0.33, 0.42]])
SPEED = np.array([0.09, 0.09, 0.02])


def normalised(corners: FloatArray) -> FloatArray:
    return (corners - LIMITS.mean(axis=1)) / np.ptp(LIMITS, axis=1)


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("sparsity", [2, 4, 5])
def test_every_direction_sweeps_the_same_volume_about_the_same_centre(direction: Direction, sparsity: int) -> None:
    """Turned back, every zig-zag fills the cube of side 1/sqrt 3 about the middle of the range."""
    u = normalised(zigzag(direction, sparsity, LIMITS)) @ _rotation_to(direction)
    np.testing.assert_allclose(u.min(axis=0), -0.5 / np.sqrt(3), atol=1e-12)
    np.testing.assert_allclose(u.max(axis=0), 0.5 / np.sqrt(3), atol=1e-12)


@pytest.mark.parametrize(
    ("direction", "reach"),
    [("J1", 1 / (2 * np.sqrt(3))), ("J2-J3", np.sqrt(2) / (2 * np.sqrt(3)))],
)
def test_joints_that_move_together_reach_as_far_as_the_study_says(direction: Direction, reach: float) -> None:
    """One joint reaches r / (2 sqrt 3), two sqrt 2 times that, three at most half the range."""
    u = normalised(zigzag(direction, 4, LIMITS))
    moving = [int(part[1]) - 1 for part in direction.split("-")]
    assert np.abs(u[:, moving]).max() == pytest.approx(reach, rel=1e-9)
    assert np.abs(normalised(zigzag("J1-J2-J3", 4, LIMITS))).max() <= 0.5 + 1e-12


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_stripes_run_along_the_direction_without_jumps(direction: Direction) -> None:
    """Every stripe moves the named joints alike and no other; steps between stripes are one spacing long."""
    steps = np.diff(normalised(zigzag(direction, 3, LIMITS)), axis=0)
    along = np.array([f"J{i}" in direction for i in (1, 2, 3)]) / np.sqrt(direction.count("J"))
    stripes = steps[::2] / np.linalg.norm(steps[::2], axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(stripes @ along), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(steps[1::2], axis=1), 1 / np.sqrt(3) / 3, atol=1e-12)


def test_the_published_zigzag_starts_where_the_studys_file_does() -> None:
    """Its first row, to every digit that is printed; joint 1 takes its whole range; other directions are the same."""
    limits = np.array([[np.deg2rad(20), np.deg2rad(60)], [np.deg2rad(55), np.deg2rad(110)], [0.33, 0.42]])
    published = zigzag("J1-J2-J3", 3, limits, as_published=True)
    np.testing.assert_allclose(published[0], [0.69848042, 1.35873351, 0.33064806], atol=1e-8)
    assert np.ptp(published[:, 0]) == pytest.approx(np.ptp(limits[0]), rel=2e-3)
    printed = zigzag("J1-J2-J3", 3, limits)
    assert 0.2 < np.abs((published - printed) / np.ptp(limits, axis=1)).max() < 0.25
    np.testing.assert_array_equal(zigzag("J2-J3", 3, limits, as_published=True), zigzag("J2-J3", 3, limits))


@pytest.mark.parametrize("ramp", [0.01, 0.2, 5.0])
def test_timing_keeps_every_speed_limit_and_meets_every_end(ramp: float) -> None:
    """No step is faster than the limit, whatever the ramp, and the path starts and ends where the corners do."""
    corners = zigzag("J1-J2", 2, LIMITS)
    path = timed(corners, SPEED, 100.0, ramp)
    assert (np.abs(np.diff(path.q, axis=0)) <= SPEED / 100.0 * (1 + 1e-9)).all()
    np.testing.assert_allclose(path.q[[0, -1]], corners[[0, -1]], atol=1e-12)


def test_a_sparser_zigzag_is_shorter() -> None:
    """Duration grows with the number of stripes."""
    durations = [timed(zigzag("J1", n, LIMITS), SPEED, 30.0).duration for n in (2, 3, 4, 5, 6)]
    assert (np.diff(durations) > 0).all()


def test_other_motions_stay_inside_limits_and_below_speeds() -> None:
    """Sinusoids and sweeps keep to range and speed."""
    rng = np.random.default_rng(3)
    for path in (
        random_sinusoids(LIMITS, SPEED, 60.0, 50.0, rng),
        random_sweeps(LIMITS, SPEED / 2, SPEED, 60.0, 50.0, rng),
    ):
        assert (path.q >= LIMITS[:, 0] - 1e-12).all()
        assert (path.q <= LIMITS[:, 1] + 1e-12).all()
        assert (np.abs(np.diff(path.q, axis=0)) <= SPEED / 50.0 * (1 + 1e-9)).all()


def test_wrong_requests_are_refused() -> None:
    """An unknown direction, falling limits, no sparsity, no speed: each with a message."""
    assert direction_named("j1-2-3") == "J1-J2-J3"
    with pytest.raises(DataError, match="runs along one of"):
        direction_named("J4")
    with pytest.raises(DataError, match="three pairs"):
        zigzag("J1", 2, LIMITS[:, ::-1])
    with pytest.raises(DataError, match="sparsity"):
        zigzag("J1", 0, LIMITS)
    with pytest.raises(DataError, match="speed limits"):
        timed(zigzag("J1", 2, LIMITS), np.zeros(3), 30.0)
