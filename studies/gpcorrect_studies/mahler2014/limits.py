"""What limits the correction: an oracle for each of the two causes, on the same reaches without tracker faults.

The tracker's own noise is in the pose that is asked for, so no model can do better than that noise; and play and dry
friction leave the arm where its past put it, which pose and velocity do not tell. Each cause is taken away in turn, by
letting the tracker be perfect, and by telling the regression the true state of the transmission.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.corrector import FitSettings, trajectory_folds
from gpcorrect.experiment import Experiment, run_experiment
from gpcorrect.gpr import SparseGPR, learn_inflation
from gpcorrect.rigid import pose_residual
from gpcorrect.sim import debridement_log, preset
from gpcorrect.sim.debridement import PRESET
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal, Progress
from gpcorrect_studies.mahler2014.regression_data import RegressionData

__all__ = ["Limit", "what_limits"]

POSITION = ROTATION = 3


@dataclass(frozen=True)
class Limit:
    """Mean error lengths on held-out reaches under one assumption, mm and degrees."""

    assumption: str
    position_mm: float
    rotation_deg: float


def what_limits(reaches: int, settings: FitSettings, progress: Progress) -> tuple[Limit, ...]:
    """Return the errors before correction, of the tracker alone, and after correction as more is known."""
    progress.step("limits", 0.0)
    noiseless = preset(PRESET).model_copy(update={"noise": None})
    seen = debridement_log(settings.seed, reaches=reaches, faults=False)
    exact = debridement_log(settings.seed, reaches=reaches, faults=False, model=noiseless)
    settings = replace(settings, clean=False, time_offset="none")
    as_seen = run_experiment(seen, settings)
    progress.step("limits", 0.3)
    as_is = run_experiment(exact, settings)
    progress.step("limits", 0.6)
    told = _told_the_transmission(as_seen, exact, settings)
    progress.step("limits", 1.0)
    assert as_seen.evaluation is not None
    assert as_seen.test is not None
    return (
        _limit("no correction", as_seen.evaluation.dirty.raw),
        _limit("pose and velocity as the tracker sees them", as_seen.evaluation.dirty.corrected),
        _limit("pose and velocity exactly (a tracker without noise): what is left is mostly memory", _corrected(as_is)),
        Limit("as seen, and the true state of the transmission: what is left is mostly the tracker's noise", **told),
        _limit("the tracker's noise alone: observed against true pose", _tracker_noise(as_seen.test, exact)),
    )


def _corrected(experiment: Experiment) -> FloatArray:
    assert experiment.evaluation is not None
    return experiment.evaluation.dirty.corrected


def _limit(assumption: str, residual: FloatArray) -> Limit:
    lengths = np.linalg.norm(residual.reshape(-1, 2, 3), axis=2).mean(axis=0)
    return Limit(assumption, 1e3 * float(lengths[0]), float(np.rad2deg(lengths[1])))


def _tracker_noise(test: CalibrationLog, exact: CalibrationLog) -> FloatArray:
    rows = np.isin(exact.trajectory, test.trajectory_ids)
    return pose_residual(_tracked(exact.select(rows)), _tracked(test))


def _told_the_transmission(experiment: Experiment, exact: CalibrationLog, settings: FitSettings) -> dict[str, float]:
    """Mean errors when motor minus joint of every axis, which play and stretch make, are features as well."""
    assert experiment.test is not None
    assert exact.measured_jp is not None
    assert exact.external_jp is not None
    state = exact.measured_jp - exact.external_jp
    state = state / state.std(axis=0)
    parts = []
    for log in (experiment.fit.log, experiment.test):
        data = RegressionData.of(experiment.corrector, log, np.ones(len(log), dtype=bool))
        hidden = state[np.isin(exact.trajectory, log.trajectory_ids)][data.rows]
        parts.append((np.hstack([data.X, hidden]), data))
    (X, train), (X_test, test) = parts
    columns = tuple(range(train.X.shape[1], X.shape[1]))
    regressor = SparseGPR(
        n_inducing=settings.inducing,
        feature_groups=(*experiment.corrector.features.groups, columns),
        output_groups=(POSITION, ROTATION),
        random_state=settings.seed,
    )
    with threadpool_limits(limits=1):
        regressor.fit(X, train.residual, groups=train.trajectory, times=train.time)
        regressor, _ = learn_inflation(regressor, X, train.residual, trajectory_folds(train.trajectory))
    return test.mean_errors(regressor.predict(X_test))


def _tracked(log: CalibrationLog) -> PoseSignal:
    assert log.tracker_cp is not None
    return log.tracker_cp
