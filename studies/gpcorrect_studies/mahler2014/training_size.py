"""Fig. 5: error and fitting time against the number of training states."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.corrector import FitSettings, trajectory_folds
from gpcorrect.experiment import Experiment
from gpcorrect.gpr import ExactGPR, SparseGPR, learn_inflation
from gpcorrect.parallel import each
from gpcorrect.types import IntArray, Progress
from gpcorrect_studies.mahler2014.regression_data import RegressionData

__all__ = ["TrainingSize", "training_sizes"]

POSITION = ROTATION = 3
MOST_EXACT = 1000  # beyond it the exact posterior costs more than it gains


@dataclass(frozen=True)
class TrainingSize:
    """One fit: number of states, method, time (s, hyperparameters included), and mean errors on held-out reaches."""

    states: int
    method: str
    seconds: float
    position_mm: float
    rotation_deg: float


def training_sizes(
    experiment: Experiment, shares: tuple[float, ...], settings: FitSettings, progress: Progress
) -> tuple[TrainingSize, ...]:
    """Fit on random states of the clean training set: exactly where they are few, and sparsely from few to all.

    Parameters
    ----------
    experiment : Experiment
        Gives registration, features, cleaned training and held-out samples.
    shares : tuple of float
        Parts of the training states, 0 to 1.
    settings : FitSettings
        Seed, also of which states are taken, and number of inducing points.
    progress : Progress
        Told after each fit.
    """
    assert experiment.test is not None
    assert experiment.evaluation is not None
    train = RegressionData.of(experiment.corrector, experiment.fit.log, experiment.fit.cleaning.keep)
    test = RegressionData.of(experiment.corrector, experiment.test, experiment.evaluation.cleaning.keep)
    order = np.random.default_rng([settings.seed, 5]).permutation(len(train.X))
    counts = [max(2, round(share * len(order))) for share in shares]
    plan = [("exact", n) for n in counts if n <= MOST_EXACT] + [("sparse", n) for n in counts]
    tasks = [(method, order[:count]) for method, count in plan]
    groups = experiment.corrector.features.groups
    return tuple(each(partial(_fit, groups, train, test, settings), tasks, progress, "Fig. 5"))


def _fit(
    groups: Sequence[Sequence[int]],
    train: RegressionData,
    test: RegressionData,
    settings: FitSettings,
    task: tuple[str, IntArray],
) -> TrainingSize:
    method, rows = task
    regressor = ExactGPR() if method == "exact" else SparseGPR(n_inducing=min(settings.inducing, len(rows)))
    regressor.set_params(feature_groups=groups, output_groups=(POSITION, ROTATION), random_state=settings.seed)
    rows = np.sort(rows)
    with threadpool_limits(limits=1):
        start = time.perf_counter()
        regressor.fit(train.X[rows], train.residual[rows], groups=train.trajectory[rows], times=train.time[rows])
        if isinstance(regressor, SparseGPR):
            folds = trajectory_folds(train.trajectory[rows])
            regressor, _ = learn_inflation(regressor, train.X[rows], train.residual[rows], folds)
        seconds = time.perf_counter() - start
    return TrainingSize(len(rows), method, seconds, **test.mean_errors(regressor.predict(test.X)))
