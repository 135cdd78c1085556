"""Fits of the regression alone: by number of training states (Fig. 5), and with more known than any tracker tells.

Two causes limit a correction from pose and velocity. The tracker's own noise is in the pose that is asked for, so no
model can do better than that noise; and play and dry friction leave the arm where its past put it. Each cause is taken
away in turn: by a tracker without noise, and by giving the regression the true state of the transmission.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import CommandCorrector, Experiment, FitSettings, folds_of, run_experiment
from gpcorrect.calibration.cartesian import INDUCING
from gpcorrect.calibration.poses import pose_pair
from gpcorrect.gpr import ExactGPR, SparseGPR, learn_inflation
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.sim import debridement_log, preset
from gpcorrect.sim.reaches import DEBRIDEMENT_PRESET
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, Progress
from gpcorrect_studies.mahler2014.table1 import held_out_of
from gpcorrect_studies.parts import Parts

# States; above, an exact fit takes over three times as long for the same error (docs/reproduce.md, Fig. 5).
MOST_EXACT = 1000
OUTPUT_GROUPS = (3, 3)  # components of position and of rotation, which share hyperparameters


@dataclass(frozen=True, eq=False)
class _Samples:
    """What the regression of a fitted corrector takes from a log.

    Inputs `X` (n, d), residuals (n, 6), trajectories and times (n,), rows of the log (n,), and the registered and the
    commanded poses.
    """

    X: FloatArray
    residual: FloatArray
    trajectory: IntArray
    time: FloatArray
    rows: IntArray
    reference: PoseSignal
    command: PoseSignal

    @classmethod
    def of(cls, corrector: CommandCorrector, log: CalibrationLog, keep: BoolArray) -> Self:
        """Take the samples of a log that pass cleaning and have both poses and a velocity, after registration."""
        samples = corrector.samples(log, keep)
        rows = samples.rows[np.isfinite(samples.X[samples.rows]).all(axis=1)]
        observed, command = pose_pair(log)
        reference = corrector.rigid.apply(observed[rows])
        return cls(
            X=samples.X[rows],
            residual=pose_residual(reference, command[rows]),
            trajectory=log.trajectory[rows],
            time=log.time[rows],
            rows=rows,
            reference=reference,
            command=command[rows],
        )

    def mean_errors(self, predicted: FloatArray) -> dict[str, float]:
        """Mean lengths of position (mm) and rotation error (deg) that remain with these residuals `(n, 6)`."""
        return _mean_lengths(pose_residual(apply_residual(self.reference, predicted), self.command))


def training_sizes(
    experiment: Experiment, fractions: tuple[float, ...], settings: FitSettings, progress: Progress, parts: Parts
) -> list[dict[str, Any]]:
    """Fit to random states of the clean training set: exactly where they are few, and sparsely from few to all.

    Parameters
    ----------
    experiment : Experiment, gives registration, features, cleaned training and held-out samples
    fractions : tuple of float, of the training states, 0 to 1
    settings : FitSettings, seed, also of which states are taken, and number of inducing points
    progress : Progress
    parts : Parts

    Returns
    -------
    list of dict
        The exact fits, then the sparse ones, each by rising number of states: `states`, `method`, `seconds` (with
        hyperparameters), and the mean lengths of held-out errors, `position_mm` and `rotation_deg`.
    """
    held_out, evaluation = held_out_of(experiment)
    train = _Samples.of(experiment.corrector, experiment.fit.log, experiment.fit.cleaning.keep)
    test = _Samples.of(experiment.corrector, held_out, evaluation.cleaning.keep)
    order = np.random.default_rng([settings.seed, 5]).permutation(len(train.X))
    counts = [max(2, round(fraction * len(order))) for fraction in fractions]
    plan = [("exact", n) for n in counts if n <= MOST_EXACT] + [("sparse", n) for n in counts]
    tasks = {f"{method}, {count}": (method, order[:count]) for method, count in plan}
    groups = experiment.corrector.features.groups
    return list(parts.each("Fig. 5", partial(_training_size, groups, train, test, settings), tasks, progress).values())


def _training_size(
    groups: Sequence[Sequence[int]], train: _Samples, test: _Samples, settings: FitSettings, task: tuple[str, IntArray]
) -> dict[str, Any]:
    method, rows = task
    regressor = ExactGPR() if method == "exact" else SparseGPR(n_inducing=min(settings.inducing or INDUCING, len(rows)))
    regressor.set_params(feature_groups=groups, output_groups=OUTPUT_GROUPS, random_state=settings.seed)
    regressor.set_params(n_learn=settings.search_samples or regressor.n_learn)
    rows = np.sort(rows)
    start = time.perf_counter()
    regressor = _fitted(regressor, train.X[rows], train.residual[rows], train.trajectory[rows], train.time[rows])
    seconds = time.perf_counter() - start
    errors = test.mean_errors(regressor.predict(test.X))
    return {"states": len(rows), "method": method, "seconds": seconds, **errors}


def _fitted(
    regressor: ExactGPR | SparseGPR, X: FloatArray, y: FloatArray, trajectory: IntArray, times: FloatArray
) -> ExactGPR | SparseGPR:
    """Fit in one thread; a sparse regressor also learns how many neighbouring samples count as one."""
    with threadpool_limits(limits=1):
        regressor.fit(X, y, groups=trajectory, times=times)
        if isinstance(regressor, SparseGPR):
            regressor, _ = learn_inflation(regressor, X, y, folds_of(trajectory))
    return regressor


def limits(reaches: int, settings: FitSettings, progress: Progress) -> list[dict[str, Any]]:
    """Return the errors before correction, after it as more is known, and of the tracker alone.

    Parameters
    ----------
    reaches : int, reaches of the recording, which has no tracker faults
    settings : FitSettings, of all fits; the clock and cleaning are left out
    progress : Progress

    Returns
    -------
    list of dict
        Five rows, in the order of `docs/reproduce.md`: the `assumption`, and under it the mean lengths of the error on
        held-out reaches, `position_mm` and `rotation_deg`.
    """
    progress.step("limits", 0.0)
    noiseless = preset(DEBRIDEMENT_PRESET).model_copy(update={"noise": None})
    seen = debridement_log(settings.seed, reaches=reaches, faults=False)
    exact = debridement_log(settings.seed, reaches=reaches, faults=False, model=noiseless)
    settings = replace(settings, clean=False, time_offset="none")
    as_seen = run_experiment(seen, settings)
    progress.step("limits", 0.3)
    as_is = run_experiment(exact, settings)
    progress.step("limits", 0.6)
    with_state = _with_transmission_state(as_seen, exact, settings)
    progress.step("limits", 1.0)
    (test, seen_errors), (_, exact_errors) = held_out_of(as_seen), held_out_of(as_is)
    true, observed = exact.select(np.isin(exact.trajectory, test.trajectory_ids)).tracker_cp, test.tracker_cp
    assert true is not None
    assert observed is not None
    errors = {
        "no correction": _mean_lengths(seen_errors.dirty.raw),
        "pose and velocity as the tracker sees them": _mean_lengths(seen_errors.dirty.corrected),
        "pose and velocity exactly (a tracker without noise): what is left is mostly memory": _mean_lengths(
            exact_errors.dirty.corrected
        ),
        "as seen, and the true state of the transmission: what is left is mostly the tracker's noise": with_state,
        "the tracker's noise alone: observed against true pose": _mean_lengths(pose_residual(true, observed)),
    }
    return [{"assumption": assumption, **lengths} for assumption, lengths in errors.items()]


def _with_transmission_state(experiment: Experiment, exact: CalibrationLog, settings: FitSettings) -> dict[str, float]:
    """Mean errors when motor minus joint of every axis, which play and stretch make, are features as well."""
    assert exact.measured_jp is not None
    assert exact.external_jp is not None
    state = exact.measured_jp - exact.external_jp
    state = state / state.std(axis=0)
    parts = []
    for log in (experiment.fit.log, held_out_of(experiment)[0]):
        samples = _Samples.of(experiment.corrector, log, np.ones(len(log), dtype=bool))
        hidden = state[np.isin(exact.trajectory, log.trajectory_ids)][samples.rows]
        parts.append((np.hstack([samples.X, hidden]), samples))
    (X, train), (X_test, test) = parts
    regressor = SparseGPR(
        n_inducing=settings.inducing or INDUCING,
        feature_groups=(*experiment.corrector.features.groups, tuple(range(train.X.shape[1], X.shape[1]))),
        output_groups=OUTPUT_GROUPS,
        random_state=settings.seed,
    )
    regressor.set_params(n_learn=settings.search_samples or regressor.n_learn)
    return test.mean_errors(_fitted(regressor, X, train.residual, train.trajectory, train.time).predict(X_test))


def _mean_lengths(residual: FloatArray) -> dict[str, float]:
    """Mean lengths of the position (mm) and rotation parts (deg) of residuals `(n, 6)`."""
    lengths = np.linalg.norm(residual.reshape(-1, 2, 3), axis=2).mean(axis=0)
    return {"position_mm": 1e3 * float(lengths[0]), "rotation_deg": float(np.rad2deg(lengths[1]))}
