"""Laws of proposing observations: they go where little is known, stay inside, and keep their promise."""

from __future__ import annotations

import numpy as np
import pytest
from support import small_log

from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector, propose
from gpcorrect.errors import DataError
from gpcorrect.gpr.statistics import Points
from gpcorrect.types import CalibrationLog, Progress


@pytest.fixture(scope="module")
def half_seen() -> tuple[CommandCorrector, CalibrationLog]:
    """Return a model that saw the right half of the workspace and a little of the left."""
    log = small_log(0, 16, samples=40)
    left = log.tracker_cp.position[:, 0] < 0.1
    rare = np.arange(len(log)) % 40 == 0
    settings = FitSettings(inducing=150, search_samples=150, marker="none", clean=False)
    return fit_corrector(log.select(~left | rare), settings), log


def test_proposals_go_where_little_is_known(half_seen: tuple[CommandCorrector, CalibrationLog]) -> None:
    """With the whole workspace as task at least two thirds of the proposals lie in the half that was hardly seen."""
    corrector, log = half_seen
    samples = corrector.samples(log, np.ones(len(log), dtype=bool))
    task = samples.X[samples.rows]
    found = propose(corrector, 12, np.random.default_rng(0), task)
    assert np.mean(found.positions[:, 0] < 0.1) > 0.6


def test_uncertainty_falls_with_every_observation(small_corrector: CommandCorrector) -> None:
    """Every observation takes some of what is left and never all of it; fewer proposals are the first of more."""
    many, few = (propose(small_corrector, n, np.random.default_rng(1)) for n in (15, 5))
    assert (np.diff(np.concatenate([[1.0], many.remaining])) < 0).all()
    assert many.remaining[-1] > 0
    np.testing.assert_array_equal(many.positions[:5], few.positions)


def test_observing_the_proposals_beats_observing_at_random(half_seen: tuple[CommandCorrector, CalibrationLog]) -> None:
    """Added to the model, proposed inputs lower the variance over the task by more than as many task points do."""
    corrector, log = half_seen
    samples = corrector.samples(log, np.ones(len(log), dtype=bool))
    task = samples.X[samples.rows]
    found = propose(corrector, 20, np.random.default_rng(2), task)
    proposed = _features(corrector, found)
    random = task[np.random.default_rng(3).choice(len(task), 20)]
    assert _variance(corrector, proposed, task) < _variance(corrector, random, task)


def test_proposals_are_poses_that_can_be_asked(small_corrector: CommandCorrector) -> None:
    """Each is a unit quaternion inside the training box, and asking for it is answered; seeds repeat."""
    found = propose(small_corrector, 10, np.random.default_rng(4))
    region = small_corrector.info()["training_region"]
    assert found.quaternions is not None
    assert found.twists is not None
    for row in range(10):
        answer = small_corrector.correct(
            np.concatenate([found.positions[row], found.quaternions[row]]), found.twists[row]
        )
        assert np.isfinite(answer.position).all()
    assert (found.positions > np.array(region["position_min"]) - 0.01).all()
    assert (found.positions < np.array(region["position_max"]) + 0.01).all()
    again = propose(small_corrector, 10, np.random.default_rng(4))
    np.testing.assert_array_equal(found.positions, again.positions)


def test_features_and_poses_convert_both_ways(small_corrector: CommandCorrector) -> None:
    """The features of a proposal's pose and twist are those that it was chosen by: the frames are undone rightly."""
    found = propose(small_corrector, 5, np.random.default_rng(5))
    X = _features(small_corrector, found)
    position, rotations, twist = small_corrector.features.inverse(X)
    np.testing.assert_allclose(small_corrector.features.transform(position, rotations, twist), X, atol=1e-9)


@pytest.mark.parametrize("count", [0, 10_000])
def test_a_silly_number_is_refused(small_corrector: CommandCorrector, count: int) -> None:
    """None and more than the candidates are errors."""
    with pytest.raises(DataError, match="between 1 and"):
        propose(small_corrector, count, np.random.default_rng(0))


def _features(corrector: CommandCorrector, found):  # type: ignore[no-untyped-def]
    from gpcorrect.calibration.one_pose import inputs

    poses = np.hstack([found.positions, found.quaternions])
    frame, region = corrector.frame, corrector.region
    return np.array(
        [inputs(p, t, np.zeros(0), frame, region)[3] for p, t in zip(poses, np.array(found.twists), strict=True)]
    )


def _variance(corrector: CommandCorrector, X: np.ndarray, task: np.ndarray) -> float:
    """Mean novelty-like variance over the task once X was observed, whatever was seen there."""
    total = 0.0
    for part, statistics in zip(corrector.law.learned.predictor.parts, corrector.law.learned.statistics, strict=True):
        new = Points.of(part).collect(X, np.zeros((len(X), len(part.offset))), Progress())
        _, std, _ = Points.of(part).posterior(statistics.plus(new)).mean_std_batch(task)
        total += float(((std**2 - part.noise) / part.signal).mean())
    return total
