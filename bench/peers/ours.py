"""gpcorrect's own regressions."""

from __future__ import annotations

from functools import partial

import numpy as np

from gpcorrect.calibration import folds_of
from gpcorrect.gpr import ExactGPR, Predictor, SparseGPR, learn_inflation
from gpcorrect.types import FloatArray, IntArray
from peers.peer import Fit, Peer, subset

Columns = tuple[tuple[int, ...], ...]
APART = (3, 3)


class Ours:
    """A fitted predictor; a single query goes through the compiled path, as it does in `correct`."""

    def __init__(self, predictor: Predictor) -> None:
        self.predictor = predictor

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations."""
        if len(X) == 1:
            mean, std, _ = self.predictor.mean_std(X[0])
            return mean, std
        return self.predictor.mean_std_batch(X)[:2]


def exact(groups: Columns, trajectory: IntArray, times: FloatArray, *, size: int) -> Fit:
    """Exact regression on a random subset."""
    return partial(_exact, groups, trajectory, times, size)


def sparse(groups: Columns, trajectory: IntArray, times: FloatArray, **options: object) -> Fit:
    """Sparse regression on everything."""
    return partial(_sparse, groups, trajectory, times, options)


def shipped(groups: Columns, trajectory: IntArray, times: FloatArray) -> Fit:
    """Fit as `gpcorrect fit` does, left-out trajectories for noise and intervals included."""
    return partial(_shipped, groups, trajectory, times)


def _exact(
    groups: Columns, trajectory: IntArray, times: FloatArray, size: int, X: FloatArray, Y: FloatArray, limit: float
) -> tuple[Peer, str]:
    rows = np.sort(subset(X, size))
    model = ExactGPR(groups, APART, n_learn=500)
    model.fit(X[rows], Y[rows], groups=trajectory[rows], times=times[rows])
    return Ours(model.predictor_), ""


def _sparse(
    groups: Columns,
    trajectory: IntArray,
    times: FloatArray,
    options: dict[str, object],
    X: FloatArray,
    Y: FloatArray,
    limit: float,
) -> tuple[Peer, str]:
    model = SparseGPR(feature_groups=groups, output_groups=APART).set_params(**options)
    return Ours(model.fit(X, Y, groups=trajectory, times=times).predictor_), ""


def _shipped(
    groups: Columns, trajectory: IntArray, times: FloatArray, X: FloatArray, Y: FloatArray, limit: float
) -> tuple[Peer, str]:
    model = SparseGPR(feature_groups=groups, output_groups=APART).fit(X, Y, groups=trajectory, times=times)
    model, _ = learn_inflation(model, X, Y, folds_of(trajectory), trajectory, times)
    return Ours(model.predictor_), ""
