"""Laws of the drift monitor: its false alarms keep their rate, real changes are found, and the future is honest."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.calibration import chance_of_larger, detect, estimate_ageing
from gpcorrect.calibration.drift import _conformal_p_values, _e_values
from gpcorrect.errors import DataError


@pytest.mark.parametrize("shape", ["gamma", "lognormal", "ties"])
def test_false_alarms_keep_their_rate(shape: str) -> None:
    """Over 400 healthy lives of 100 trajectories alarms come no more often than once in the stated 200 trajectories."""
    rng = np.random.default_rng(0)
    draw = {
        "gamma": lambda n: rng.gamma(20, 0.05, n),
        "lognormal": lambda n: rng.lognormal(0, 0.5, n),
        "ties": lambda n: rng.integers(1, 4, n).astype(float),
    }[shape]
    alarms, lived = 0, 0
    for _ in range(400):
        found = detect(draw(30), draw(100), 200.0, rng)
        alarms += found.alarm is not None
        lived += 100 if found.alarm is None else found.alarm + 1
    assert alarms / lived <= 1 / 200


def test_p_values_of_the_unchanged_are_uniform() -> None:
    """Ranks among all before are uniform and independent, from the first to the last."""
    rng = np.random.default_rng(1)
    p = np.array([_conformal_p_values(rng.gamma(5, 1, 20), rng.gamma(5, 1, 30), rng) for _ in range(2000)])
    np.testing.assert_allclose(p.mean(axis=0), 0.5, atol=0.04)
    np.testing.assert_allclose((p < 0.1).mean(axis=0), 0.1, atol=0.035)
    assert abs(np.corrcoef(p[:, 10], p[:, 11])[0, 1]) < 0.08


def test_bets_are_fair() -> None:
    """E-values of uniform p-values have a mean of one at most, and fall with p."""
    p = (np.arange(2_000_000) + 0.5) / 2_000_000
    assert _e_values(p).mean() <= 1.0
    assert (np.diff(_e_values(np.linspace(1e-6, 1 - 1e-6, 1000))) < 0).all()


def test_a_jump_is_found_soon_and_not_before() -> None:
    """Errors twice as large from trajectory 40 on raise the alarm within 15 more, in at least nine lives of ten."""
    rng, found = np.random.default_rng(2), 0
    for _ in range(50):
        scores = rng.gamma(20, 0.05, 70) * np.where(np.arange(70) < 40, 1.0, 2.0)
        alarm = detect(rng.gamma(20, 0.05, 40), scores, 1000.0, rng).alarm
        found += alarm is not None and 40 <= alarm < 55
    assert found >= 45


@pytest.mark.parametrize(("factor", "least"), [(1.7, 0.8), (2.5, 0.95)])
def test_few_scores_at_the_fit_are_enough(factor: float, least: float) -> None:
    """Beside 29 scores at the fit, 16 trajectories that err more from the first one on raise the alarm."""
    found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        found += detect(rng.gamma(20, 0.05, 29), factor * rng.gamma(20, 0.05, 16), 1000.0, rng).alarm is not None
    assert found >= 100 * least


@pytest.mark.parametrize("shape", ["gamma", "ties"])
def test_a_recording_is_rarely_called_larger_by_chance(shape: str) -> None:
    """Of 4,000 unchanged recordings of eight trajectories a hundredth, or fewer, have a chance below a hundredth."""
    rng = np.random.default_rng(3)
    draw = {"gamma": lambda n: rng.gamma(5, 1, n), "ties": lambda n: rng.integers(1, 6, n).astype(float)}[shape]
    chances = np.array([chance_of_larger(draw(29), draw(8)) for _ in range(4000)])
    assert 0.001 < (chances <= 0.01).mean() < 0.0145  # three standard deviations above


def test_eight_trajectories_are_enough_for_a_recording() -> None:
    """Beside 29 scores at the fit, eight that are 1.7 times as large are told at one in 1000; none is told of none."""
    found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        found += chance_of_larger(rng.gamma(20, 0.05, 29), 1.7 * rng.gamma(20, 0.05, 8)) < 1e-3
    assert found >= 95
    assert chance_of_larger(np.ones(29), np.empty(0)) == 1.0


def history(rng: np.random.Generator, growth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Scores at the fit, and of six logs of eight trajectories, one day apart; their growth a day is planted."""
    logs = np.repeat(np.arange(6), 8)
    ages = logs + 1.0
    return rng.gamma(40, 0.025, 30), rng.gamma(40, 0.025, 48) + growth * ages, ages, logs


def test_remaining_time_is_found_with_an_interval_that_holds() -> None:
    """With a planted growth of 0.05 a day the time to twice the score is covered in at least 85 of 100 lives."""
    rng, covered, called = np.random.default_rng(3), 0, 0
    for _ in range(100):
        found = estimate_ageing(*history(rng, 0.05), 2.0, rng)
        if found.remaining95 is not None:
            called += 1
            covered += found.remaining95[0] <= 1.0 / 0.05 - 6.0 <= found.remaining95[1]
    assert called >= 90
    assert covered >= 0.85 * called


def test_what_does_not_age_is_not_said_to() -> None:
    """Without growth at most one life in ten is called ageing, and then nothing remains to be told."""
    rng = np.random.default_rng(4)
    found = [estimate_ageing(*history(rng, 0.0), 2.0, rng) for _ in range(100)]
    assert sum(f.ageing for f in found) <= 10
    assert all(f.remaining is None and f.remaining95 is None for f in found if not f.ageing)


def test_what_is_worn_out_has_no_time_left() -> None:
    """Once the line has passed the limit the remaining time is zero."""
    rng = np.random.default_rng(5)
    found = estimate_ageing(*history(rng, 0.5), 2.0, rng)
    assert found.remaining == 0.0


def test_a_step_between_two_days_is_not_called_ageing() -> None:
    """Two recordings after the fit may differ by the day, whatever their trajectories say; a third makes a line."""
    rng = np.random.default_rng(7)
    baseline, scores, ages, logs = history(rng, 0.05)
    for last, told in ((1, None), (2, None), (3, True)):
        rows = logs < last
        found = estimate_ageing(baseline, scores[rows] + 1.0, ages[rows], logs[rows], 3.0, rng)
        assert found.ageing is told
        assert (found.remaining is None) == (told is None)


def test_bad_questions_are_refused() -> None:
    """Too few scores at the fit, a rate of every trajectory, an age of zero, a limit below the start."""
    rng = np.random.default_rng(6)
    ones = np.ones(10)
    with pytest.raises(DataError, match="left-out"):
        detect(np.ones(3), ones, 100.0, rng)
    with pytest.raises(DataError, match="more than 1"):
        detect(ones, ones, 1.0, rng)
    with pytest.raises(DataError, match="age"):
        estimate_ageing(ones, ones, 0 * ones, np.zeros(10, dtype=int), 2.0, rng)
    with pytest.raises(DataError, match="more than 1"):
        estimate_ageing(ones, ones, ones, np.zeros(10, dtype=int), 1.0, rng)
