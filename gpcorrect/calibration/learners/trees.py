"""Boosted trees: what a general learner makes of the same inputs, jumps and thresholds included.

scikit-learn grows them (histogram gradient boosting, after Ke et al. 2017); what is stored and asked is a table of
their nodes, so that a model file holds numbers only and an answer needs no scikit-learn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted, cross_predicted
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.types import FloatArray, IntArray, Progress

__all__ = ["Trees", "TreesMap"]

ROUNDS, RATE, LEAST_IN_LEAF = 200, 0.08, 20
"""Trees of each target, their learning rate, samples in a leaf; chosen by hand."""
CHUNK = 2_000_000
"""Nodes that are looked at together: bounds the memory of an answer to a long path."""


@dataclass(frozen=True, eq=False)
class TreesMap:
    """Sums of regression trees, the trees of all targets in one table of nodes.

    Parameters
    ----------
    feature : (k,) int array
        Input that a node looks at; -1 in leaves.
    threshold : (k,) array
        Inputs up to it go left, those above go right.
    left, right : (k,) int arrays
        Next nodes; a leaf's are itself.
    value : (k,) array
        Of leaves, m or rad.
    roots : (t,) int array
        First node of each tree.
    target : (t,) int array
        Which target a tree adds to.
    depth : int
        Steps from any root to its leaves, at most.
    base : (m,) array
        Sum of no trees.
    std : (m,) array
        Standard deviation of what is left in training.
    """

    feature: IntArray
    threshold: FloatArray
    left: IntArray
    right: IntArray
    value: FloatArray
    roots: IntArray
    target: IntArray
    depth: int
    base: FloatArray
    std: FloatArray

    @classmethod
    def fit(cls, X: FloatArray, Y: FloatArray, seed: int) -> Self:
        """Grow the trees of each target.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays
            Inputs and targets.
        seed : int
            Of the samples that bins are made from.
        """
        from sklearn.ensemble import HistGradientBoostingRegressor

        grown = [
            HistGradientBoostingRegressor(
                max_iter=ROUNDS,
                learning_rate=RATE,
                min_samples_leaf=LEAST_IN_LEAF,
                early_stopping=False,
                random_state=seed,
            ).fit(X, y)
            for y in Y.T
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
            feature=np.where(leaf, -1, nodes["feature_idx"]).astype(np.int64),
            threshold=np.where(leaf, 0.0, nodes["num_threshold"]),
            left=np.where(leaf, own, nodes["left"] + shift).astype(np.int64),
            right=np.where(leaf, own, nodes["right"] + shift).astype(np.int64),
            value=np.where(leaf, nodes["value"], 0.0),
            roots=roots,
            target=np.array([k for k, _ in tables]),
            depth=int(nodes["depth"].max()),
            base=np.array([float(np.squeeze(model._baseline_prediction)) for model in grown]),
            std=np.zeros(Y.shape[1]),
        )
        return replace(learned, std=(Y - learned.mean(X)).std(axis=0))

    @property
    def extrapolates(self) -> bool:
        """False: a tree's answer outside its training inputs is that of the nearest leaf."""
        return False

    def mean(self, X: FloatArray) -> FloatArray:
        """Return means `(n, m)` at inputs `(n, d)`.

        Parameters
        ----------
        X : (n, d) array
            Inputs.
        """
        mean = np.tile(self.base, (len(X), 1))
        for start in range(0, len(X), step := max(1, CHUNK // len(self.roots))):
            rows = X[start : start + step]
            values = self.value[self._leaves(rows)]
            for k in range(len(self.base)):
                mean[start : start + step, k] += values[:, self.target == k].sum(axis=1)
        return mean

    def _leaves(self, X: FloatArray) -> IntArray:
        """Return the leaf `(n, t)` that each input reaches in each tree, all of them a level at a time."""
        at = np.tile(self.roots, (len(X), 1))
        row = np.arange(len(X))[:, None]
        for _ in range(self.depth):
            goes_left = X[row, self.feature[at]] <= self.threshold[at]  # in a leaf, both ways stay
            at = np.where(goes_left, self.left[at], self.right[at])
        return at

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`."""
        mean = self.mean(X)
        return mean, np.broadcast_to(self.std, mean.shape), np.zeros(len(X))


class Trees:
    """The learner of :class:`TreesMap`."""

    def fit(self, samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
        """See :class:`Learner`."""

        def _learn(part: Samples) -> TreesMap:
            return TreesMap.fit(*part.learnable(), settings.seed)

        return Fitted(_learn(samples), cross_predicted(_learn, samples, LIMITS.folds))
