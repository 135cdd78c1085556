"""Boosted trees, after a linear law where the task has one: what jumps and thresholds a smooth field cannot follow.

The linear law goes on where trees stop: at a load above all that was recorded, on the spindle of
docs/joint-measured.md, trees alone were twice as wrong as after it.

scikit-learn grows them (histogram gradient boosting, after Ke et al. 2017); what is stored and asked is a table of
their nodes, so that a model file holds numbers only and an answer needs no scikit-learn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numba import njit

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted, fitted
from gpcorrect.calibration.learners.polynomial import PolynomialMap
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, IntArray, Progress

ROUNDS, RATE, BINS, LEAST_IN_LEAF = 100, 0.15, 64, 20
"""Trees of each target, their learning rate, bins of an input, samples in a leaf. Twice the trees at half the rate with
255 bins take three times as long and leave as much, on joints of four machines after their law (0.93 to
1.10, of the last quarter held out); 60 trees at 0.2 leave 1.01 times as much. Chosen by hand."""


@dataclass(frozen=True, eq=False)
class TreesMap:
    """A linear law and sums of regression trees of what it leaves, the trees of all targets in one table of nodes."""

    linear: PolynomialMap | None  # of degree 1
    feature: IntArray  # (k,) input that a node looks at; -1 in leaves
    threshold: FloatArray  # (k,) inputs up to it go left, those above go right
    # (k,) each: next nodes; a leaf's are itself
    left: IntArray
    right: IntArray
    value: FloatArray  # (k,) of leaves, m or rad
    roots: IntArray  # (t,) first node of each tree
    target: IntArray  # (t,) which target a tree adds to
    base: FloatArray  # (m,) sum of no trees
    std: FloatArray  # (m,) standard deviation of what is left in training

    def __post_init__(self) -> None:
        k, own = len(self.feature), np.flatnonzero(self.feature >= 0)
        after = [(side[own] > own).all() and (side[own] < k).all() for side in (self.left, self.right)]
        sizes = {len(part) for part in (self.feature, self.threshold, self.left, self.right, self.value)}
        inside = ((self.roots >= 0) & (self.roots < k)).all() and (
            (self.target >= 0) & (self.target < len(self.base))
        ).all()
        if len(sizes) > 1 or not (all(after) and inside) or len(self.roots) != len(self.target):
            raise DataError("the stored trees are damaged: nodes do not lead to leaves.")

    @classmethod
    def fit(cls, X: FloatArray, Y: FloatArray, seed: int, penalties: FloatArray | None = None) -> Self:
        """Grow the trees of each target.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and targets
        seed : int, of the samples that bins are made from
        penalties : (d, m) array, optional, of a linear law that comes before; none without
        """
        from sklearn.ensemble import HistGradientBoostingRegressor

        linear = None if penalties is None else PolynomialMap.fit(X, Y, 1, penalties)
        left = Y if linear is None else Y - linear.mean(X)
        grown = [
            HistGradientBoostingRegressor(
                max_iter=ROUNDS,
                learning_rate=RATE,
                max_bins=BINS,
                min_samples_leaf=LEAST_IN_LEAF,
                early_stopping=False,
                random_state=seed,
            ).fit(X, y)
            for y in left.T
        ]
        # scikit-learn has no public table of these trees; a test holds this one against its own predictions.
        tables: list[tuple[int, Any]] = [
            (k, stage[0].nodes) for k, model in enumerate(grown) for stage in model._predictors
        ]
        sizes = [len(nodes) for _, nodes in tables]
        roots = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
        nodes = np.concatenate([table for _, table in tables])
        leaf, own = nodes["is_leaf"].astype(bool), np.arange(len(nodes))
        shift = np.repeat(roots, sizes)
        learned = cls(
            linear=linear,
            feature=np.where(leaf, -1, nodes["feature_idx"]).astype(np.int64),
            threshold=np.where(leaf, 0.0, nodes["num_threshold"]),
            left=np.where(leaf, own, nodes["left"] + shift).astype(np.int64),
            right=np.where(leaf, own, nodes["right"] + shift).astype(np.int64),
            value=np.where(leaf, nodes["value"], 0.0),
            roots=roots,
            target=np.array([k for k, _ in tables]),
            base=np.array([float(np.squeeze(model._baseline_prediction)) for model in grown]),
            std=np.zeros(Y.shape[1]),
        )
        return replace(learned, std=(Y - learned.mean(X)).std(axis=0))

    @property
    def extrapolates(self) -> bool:
        """Whether there is a linear law; a tree's answer outside its training inputs is that of the nearest leaf."""
        return self.linear is not None

    def mean(self, X: FloatArray) -> FloatArray:
        """Return means `(n, m)` at inputs `(n, d)`.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        if X.shape[1] <= self.feature.max():
            raise DataError(f"the trees look at {self.feature.max() + 1} inputs, got {X.shape[1]}.")
        mean = np.tile(self.base, (len(X), 1)) if self.linear is None else self.base + self.linear.mean(X)
        _add_leaves(mean, X, self.feature, self.threshold, self.left, self.right, self.value, self.roots, self.target)
        return mean

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`."""
        mean = self.mean(X)
        return mean, np.broadcast_to(self.std, mean.shape), np.zeros(len(X))


@njit(cache=True)
def _add_leaves(
    mean: FloatArray,
    X: FloatArray,
    feature: IntArray,
    threshold: FloatArray,
    left: IntArray,
    right: IntArray,
    value: FloatArray,
    roots: IntArray,
    target: IntArray,
) -> None:
    """Add to means `(n, m)` the leaves that their inputs reach; children stand behind their parents."""
    for i in range(len(X)):
        for t in range(len(roots)):
            at = roots[t]
            while feature[at] >= 0:
                at = left[at] if X[i, feature[at]] <= threshold[at] else right[at]
            mean[i, target[t]] += value[at]


def learn_trees(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`TreesMap`."""
    seed, penalties = settings.seed, layout.penalties
    return fitted(lambda part: TreesMap.fit(*part.learnable(), seed, penalties), samples, LIMITS.folds)
