"""Learns the residual H and how far its intervals can be trusted, by leaving out whole trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.gpr import IntervalCalibration, Predictor, SparseGPR, Statistics, learn_inflation, novelty_limit
from gpcorrect.types import FloatArray, IntArray, Progress

__all__ = ["ResidualModel", "fit_residual_model", "trajectory_folds"]

FOLDS = 4
POSITION = ROTATION = 3  # outputs that share a kernel: three positions, three rotations


@dataclass(frozen=True, eq=False)
class ResidualModel:
    """The learned residual.

    Parameters
    ----------
    predictor : Predictor
        Residuals `(k,)` of an input.
    intervals : IntervalCalibration
        Calibrated on the errors below.
    novelty : float
        Novelty beyond which the model extrapolates.
    statistics : tuple of Statistics
        What the predictor rests on, a group of outputs each: more data can be added.
    errors, std : (n, k) arrays
        Errors at every training sample of the model that its trajectory was left out of, and what it promised.
    """

    predictor: Predictor
    intervals: IntervalCalibration
    novelty: float
    statistics: tuple[Statistics, ...]
    errors: FloatArray
    std: FloatArray


def fit_residual_model(
    X: FloatArray,
    residual: FloatArray,
    trajectory: IntArray,
    time: FloatArray,
    feature_groups: Sequence[Sequence[int]],
    *,
    inducing: int,
    seed: int,
    progress: Progress,
) -> ResidualModel:
    """Learn residuals `(n, k)` from inputs `(n, d)`, whose columns act by groups, of trajectories at times `(n,)`.

    How many neighbouring samples count as one is chosen, and intervals are calibrated, on errors at trajectories that
    the model was not fitted to, so that both hold on trajectories never seen. Hyperparameters are of all trajectories;
    where these are few, they are learned without the left-out ones for this (:func:`gpcorrect.gpr.learn_inflation`).
    """
    regressor = SparseGPR(
        n_inducing=inducing,
        feature_groups=feature_groups,
        output_groups=(POSITION, ROTATION) if residual.shape[1] == POSITION + ROTATION else None,
        random_state=seed,
    )
    regressor.fit(X, residual, groups=trajectory, times=time, progress=progress)
    folds = trajectory_folds(trajectory)
    regressor, left_out = learn_inflation(regressor, X, residual, folds, trajectory, time, progress)
    return ResidualModel(
        predictor=regressor.predictor_,
        intervals=IntervalCalibration.fit(left_out.errors, left_out.std, trajectory),
        novelty=novelty_limit(left_out.novelty),
        statistics=regressor.statistics_,
        errors=left_out.errors,
        std=left_out.std,
    )


def trajectory_folds(trajectory: IntArray) -> IntArray:
    """Fold `(n,)` of each sample: neighbouring whole trajectories, or blocks of time when there are fewer than two.

    Neighbours are left out together, for an arm changes slowly: a trajectory between two that were learned from is
    predicted better than any to come. (Taken in turn they gave intervals on simulated debridement that covered 79 to
    85 % of the worst axis of later trajectories, blocks 87 to 97 %.)
    """
    ids, first, index = np.unique(trajectory, return_index=True, return_inverse=True)
    if len(ids) < 2:
        return np.arange(len(trajectory)) * FOLDS // len(trajectory)
    order = np.argsort(np.argsort(first))  # of recording, whatever the numbers
    folds: IntArray = order[index] * min(FOLDS, len(ids)) // len(ids)
    return folds
