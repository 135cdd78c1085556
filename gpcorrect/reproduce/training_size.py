"""Fig. 5: error and fitting time against the number of training states."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.experiment import Experiment
from gpcorrect.gpr import ExactGPR, SparseGPR
from gpcorrect.reproduce.regression_data import RegressionData
from gpcorrect.types import Progress

__all__ = ["TrainingSize", "training_sizes"]

POSITION = ROTATION = 3
INDUCING = 700  # as a fit takes by default
MOST_EXACT = 1000  # beyond it the exact posterior costs more than it gains


@dataclass(frozen=True)
class TrainingSize:
    """One fit: how many states, by which method, how long (s, hyperparameters included), how good on held-out reaches."""

    states: int
    method: str
    seconds: float
    position_mm: float
    rotation_deg: float


def training_sizes(
    experiment: Experiment, shares: tuple[float, ...], seed: int, progress: Progress
) -> tuple[TrainingSize, ...]:
    """Fit on random states of the clean training set: exactly where they are few, through inducing points from few to all.

    Parameters
    ----------
    experiment : Experiment
        Gives registration, features, cleaned training and held-out samples.
    shares : tuple of float
        Parts of the training states, 0 to 1.
    seed : int
        Of which states are taken.
    progress : Progress
        Told after each fit.
    """
    assert experiment.test is not None
    assert experiment.evaluation is not None
    train = RegressionData.of(experiment.corrector, experiment.fit.log, experiment.fit.cleaning.keep)
    test = RegressionData.of(experiment.corrector, experiment.test, experiment.evaluation.cleaning.keep)
    order = np.random.default_rng([seed, 5]).permutation(len(train.X))
    counts = [max(2, round(share * len(order))) for share in shares]
    plan = [("exact", n) for n in counts if n <= MOST_EXACT] + [("sparse", n) for n in counts]
    points = []
    for done, (method, count) in enumerate(plan):
        progress.step("Fig. 5", done / len(plan))
        points.append(_fit(experiment, train, test, order[:count], method, seed))
    progress.step("Fig. 5", 1.0)
    return tuple(points)


def _fit(
    experiment: Experiment, train: RegressionData, test: RegressionData, rows: np.ndarray, method: str, seed: int
) -> TrainingSize:
    groups = experiment.corrector.features.groups
    shared = {"feature_groups": groups, "output_groups": (POSITION, ROTATION), "random_state": seed}
    regressor = ExactGPR(**shared) if method == "exact" else SparseGPR(n_inducing=min(INDUCING, len(rows)), **shared)
    rows = np.sort(rows)
    with threadpool_limits(limits=1):
        start = time.perf_counter()
        regressor.fit(train.X[rows], train.residual[rows], groups=train.trajectory[rows], times=train.time[rows])
        seconds = time.perf_counter() - start
    return TrainingSize(len(rows), method, seconds, **test.mean_errors(regressor.predict(test.X)))
