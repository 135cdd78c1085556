"""The Gaussian process on joints: a linear law with plays, then a smooth field of what it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.gpr import Predictor, SparseGPR
from gpcorrect.joint import PolynomialMap, zero_path
from gpcorrect.joint_corrector.law import linear_law
from gpcorrect.types import FloatArray, IntArray, Progress

__all__ = ["GPMap", "learn_gp"]

FEWEST_STRETCHES = 40  # into which the recording is cut for noise that neighbours share: long ones cost their cube


@dataclass(frozen=True, eq=False)
class GPMap:
    """Linear law on all features, and a regression on those that may act in a curved way.

    Parameters
    ----------
    linear : PolynomialMap
        Of degree 1.
    columns : (k,) int array
        Features of the regression.
    predictor : Predictor
        Of what the linear law leaves.
    """

    linear: PolynomialMap
    columns: IntArray
    predictor: Predictor

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations of a new observation `(n, m)`."""
        mean, std, _ = self.predictor.mean_std_batch(X[:, self.columns])
        return self.linear.predict(X)[0] + mean, std

    def predict_one(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation `(m,)` for one sample's features `(d,)`: the hot path."""
        mean, std, _ = self.predictor.mean_std(x[self.columns])
        return self.linear.predict(x[None])[0][0] + mean, std


def learn_gp(
    X: FloatArray,
    Y: FloatArray,
    trajectory: IntArray,
    time: FloatArray,
    columns: IntArray,
    *,
    inducing: int,
    seed: int,
    penalties: FloatArray | None = None,
    progress: Progress | None = None,
) -> tuple[GPMap, FloatArray]:
    """Learn from features `(n, d)` and errors `(n, m)`; also return where each joint's zero stood last `(m,)`.

    `penalties` (k, m) are those of the linear law. A zero that wanders is taken out before the field is learned: it is
    a matter of time, not of place.
    """
    zero = zero_path(Y - linear_law(X, Y, penalties).predict(X)[0], trajectory)
    linear = linear_law(X, Y - zero.samples, penalties)
    left = Y - zero.samples - linear.predict(X)[0]
    regressor = SparseGPR(
        n_inducing=inducing,
        n_variance=min(inducing, 150),
        output_groups=[1] * Y.shape[1],
        random_state=seed,
    ).fit(X[:, columns], left, groups=_stretches(trajectory), times=time, progress=progress)
    return GPMap(linear, np.asarray(columns), regressor.predictor_), zero.last


def _stretches(trajectory: IntArray) -> IntArray:
    """Trajectories, cut further so that no stretch is longer than its share of the recording."""
    longest = -(-len(trajectory) // FEWEST_STRETCHES)
    before = np.flatnonzero(np.diff(trajectory, prepend=trajectory[:1]) != 0)
    starts = np.concatenate([[0], before])
    own = np.repeat(starts, np.diff(np.concatenate([starts, [len(trajectory)]])))
    place = np.arange(len(trajectory))
    cut = ((place - own) // longest) * longest + own
    labels: IntArray = np.unique(cut, return_inverse=True)[1].astype(np.int64)
    return labels
