from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.errors import DataError
from gpcorrect.gpr import IntervalCalibration, novelty_limit


def trajectories(count: int, length: int, rng: np.random.Generator, tail: str = "normal"):  # type: ignore[no-untyped-def]
    """Errors that share a part inside a trajectory, deviations that are wrong by a factor per output, and groups."""
    groups = np.repeat(np.arange(count), length)
    std = rng.uniform(0.5, 2.0, (count * length, 2))
    draw = rng.standard_normal if tail == "normal" else (lambda shape: rng.standard_t(4, shape))
    shared = np.repeat(draw((count, 2)), length, axis=0)
    errors = std * (0.6 * shared + 0.8 * draw((count * length, 2))) * [0.4, 3.0]
    return errors, std, groups


@pytest.mark.parametrize("tail", ["normal", "student"])
@pytest.mark.parametrize("count", [8, 30, 120])
def test_intervals_cover_93_to_97_percent_of_new_trajectories(count: int, tail: str) -> None:
    """Over seeds, whatever the deviations were wrong by and however few trajectories there are."""
    shares = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        intervals = IntervalCalibration.fit(*trajectories(count, 30, rng, tail))
        errors, std, _ = trajectories(200, 30, rng, tail)
        shares.append((np.abs(errors) <= intervals.interval95(std)).mean(axis=0))
    assert (np.abs(np.mean(shares, axis=0) - 0.95) < 0.02).all()


def test_right_normal_deviations_need_a_factor_of_1_96() -> None:
    """With nothing to correct, nothing is corrected."""
    rng = np.random.default_rng(0)
    std = rng.uniform(0.5, 2.0, (40_000, 1))
    intervals = IntervalCalibration.fit(std * rng.standard_normal(std.shape), std, np.repeat(np.arange(400), 100))
    np.testing.assert_allclose(intervals.factor, 1.96, rtol=0.03)


def test_the_factor_follows_the_scale_of_the_errors() -> None:
    """Errors three times as large need intervals three times as wide."""
    errors, std, groups = trajectories(20, 30, np.random.default_rng(1))
    np.testing.assert_allclose(
        IntervalCalibration.fit(3 * errors, std, groups).factor, 3 * IntervalCalibration.fit(errors, std, groups).factor
    )


def test_a_long_trajectory_counts_no_more_than_a_short_one() -> None:
    """Repeating every sample of one trajectory a hundred times changes next to nothing."""
    errors, std, groups = trajectories(30, 30, np.random.default_rng(2))
    rows = np.concatenate([np.arange(900), np.tile(np.flatnonzero(groups == 4), 100)])
    longer = IntervalCalibration.fit(errors[rows], std[rows], groups[rows]).factor
    np.testing.assert_allclose(longer, IntervalCalibration.fit(errors, std, groups).factor, rtol=0.02)


def test_one_trajectory_gives_its_own_quantile() -> None:
    """There is nothing to leave out, so the plain 95 % quantile is all there is."""
    errors, std, _ = trajectories(1, 200, np.random.default_rng(3))
    factor = IntervalCalibration.fit(errors, std, np.zeros(200, dtype=int)).factor
    inside = (np.abs(errors) <= factor * std).mean(axis=0)
    np.testing.assert_allclose(inside, 0.95, atol=0.006)


def recording(parts: int, spread: float, rng: np.random.Generator):  # type: ignore[no-untyped-def]
    """Errors of parts of ten trajectories each, whose scales differ from part to part."""
    part = np.repeat(np.arange(parts), 300)
    std = np.ones((len(part), 1))
    scale = np.exp(spread * rng.standard_normal((parts, 1)))
    return scale[part] * rng.standard_normal(std.shape), std, np.arange(len(part)) // 30, part


def test_where_parts_differ_four_in_five_parts_to_come_are_covered() -> None:
    """Over seeds; without parts fewer are, for only the pool of the known ones is looked at."""
    covered = {True: 0, False: 0}
    for seed in range(200):
        rng = np.random.default_rng(seed)
        errors, std, groups, part = recording(4, 0.4, rng)
        new = np.exp(0.4 * rng.standard_normal()) * rng.standard_normal(3000)
        for allowing in covered:
            factor = IntervalCalibration.fit(errors, std, groups, part if allowing else None).factor
            covered[allowing] += np.mean(np.abs(new) <= factor) >= 0.945
    assert covered[True] / 200 == pytest.approx(0.82, abs=0.06)
    assert covered[False] < covered[True] - 10


def test_where_parts_are_alike_the_allowance_for_them_is_small() -> None:
    """And a lone part asks for none."""
    errors, std, groups, part = recording(4, 0.0, np.random.default_rng(5))
    alone = IntervalCalibration.fit(errors, std, groups).factor
    assert 1.0 <= IntervalCalibration.fit(errors, std, groups, part).factor / alone < 1.1
    np.testing.assert_array_equal(IntervalCalibration.fit(errors, std, groups, 0 * part).factor, alone)


def test_errors_that_are_all_but_zero_in_a_part_leave_intervals_finite() -> None:
    """A joint that stood still for a while says little of how much parts differ."""
    errors, std, groups, part = recording(4, 0.0, np.random.default_rng(6))
    errors[part == 2] = 0.0
    assert IntervalCalibration.fit(errors, std, groups, part).factor < 10
    assert IntervalCalibration.fit(0 * errors, std, groups, part).factor < 1e-100


def test_bad_input_is_refused() -> None:
    """Shapes that differ, and deviations of zero."""
    with pytest.raises(DataError, match="groups"):
        IntervalCalibration.fit(np.zeros((3, 2)), np.ones((3, 1)), np.zeros(3, dtype=int))
    with pytest.raises(DataError, match="positive"):
        IntervalCalibration.fit(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(3, dtype=int))


def test_the_novelty_limit_lets_through_the_share_it_promises() -> None:
    """99.5 % of what it was learned from counts as inside."""
    novelty = np.random.default_rng(4).beta(1, 20, 5000)
    assert np.mean(novelty <= novelty_limit(novelty)) == pytest.approx(0.995, abs=0.001)
