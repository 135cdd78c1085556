"""Sparse Gaussian-process regression: all data through inducing points, in blocks, at a cost linear in their number.

The variational posterior of Titsias (2009), from sums over samples (:mod:`gpcorrect.gpr.statistics`); one spectrum
serves all outputs and every noise variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import reduce
from typing import Self

import numpy as np
from scipy.linalg import solve_triangular

from gpcorrect.gpr.estimator import GaussianProcess
from gpcorrect.gpr.kernels import Kernel
from gpcorrect.gpr.learning import KernelOption, Learned
from gpcorrect.gpr.linalg import cholesky
from gpcorrect.gpr.predictor import Predictor, SharedPredictor
from gpcorrect.gpr.statistics import Points, Statistics, collected, resting_on
from gpcorrect.types import FloatArray, IntArray, Progress

CANDIDATES_PER_POINT = 5  # chosen by hand, as is the next: more candidates cost time in proportion
FEWEST_CANDIDATES = 4096  # at least, chosen by hand
BLOCK = 64  # points drawn at once: changes the speed only
TOLERANCE = 1e-7  # of the prior variance: a sample explained to this is the same point to rounding


class SparseGPR(GaussianProcess):
    """Variational inducing-point regression (Titsias 2009): hyperparameters from a subset, then all data.

    Parameters
    ----------
    n_inducing : int, inducing points that the mean rests on
    n_variance : int, how many of them the variance rests on: the part of a query that costs their square
    feature_groups, output_groups, n_learn, kernel
        As for :class:`ExactGPR`.
    inflation : sequence of float, optional
        For each group of outputs, how many neighbouring samples count as one, because they err together; 1 by default.
        :func:`gpcorrect.gpr.learn_inflation` learns it.
    random_state : int, RandomState or None, seed of the subset and the inducing points

    Attributes
    ----------
    jitter_ : float
        What had to be added to the inducing points' correlations (of unit variance) for their factorisation;
        the largest of the groups of outputs.
    unseen_ : float, mean share of prior variance that the inducing points cannot see at the training samples; likewise
    points_ : tuple of Points, what each group of outputs rests on, its covariance factored
    statistics_ : tuple of Statistics, what the posterior of each group of outputs rests on; data can be added to it

    See Also
    --------
    GaussianProcess : the other attributes.
    """

    def __init__(
        self,
        n_inducing: int = 700,
        n_variance: int = 250,
        feature_groups: Sequence[Sequence[int]] | None = None,
        output_groups: Sequence[int] | None = None,
        n_learn: int = 500,
        inflation: Sequence[float] | None = None,
        kernel: KernelOption = "rbf",
        random_state: int | None = 0,
    ) -> None:
        self.n_inducing = n_inducing
        self.n_variance = n_variance
        self.feature_groups = feature_groups
        self.output_groups = output_groups
        self.n_learn = n_learn
        self.inflation = inflation
        self.kernel = kernel
        self.random_state = random_state

    points_: tuple[Points, ...]
    statistics_: tuple[Statistics, ...]
    by_part_: tuple[tuple[Statistics, ...], ...]
    _parts: tuple[list[IntArray], FloatArray, int] | None = None

    def fit_by_parts(
        self,
        X: FloatArray,
        Y: FloatArray,
        parts: IntArray,
        terms: FloatArray | None = None,
        *,
        stride: int = 1,
        groups: IntArray | None = None,
        times: FloatArray | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Fit, and keep what the posterior rests on part by part, so that parts can be left out: `by_part_`.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and outputs
        parts : (n,) array, which samples are left out together; `by_part_` is in the order of their labels
        terms : (n, k) array, optional, see :meth:`Points.collect`
        stride : int
            Every so-manieth sample of a part is summed, and stands for those between, which are like it; see
            :meth:`with_all`.
        groups, times, progress
            See :meth:`fit`.
        """
        rows = [np.flatnonzero(parts == part) for part in np.unique(parts)]
        self._parts = rows, np.zeros((len(X), 0)) if terms is None else terms, stride
        try:
            return self.fit(X, Y, groups, times, progress)
        finally:
            self._parts = None

    def with_all(self, X: FloatArray, Y: FloatArray, parts: IntArray) -> Self:
        """Return a copy that rests on all samples, under the same points and hyperparameters.

        Parameters
        ----------
        X, Y, parts
            As for :meth:`fit_by_parts`.
        """
        other = copy(self)
        each = [parts == part for part in np.unique(parts)]
        other.by_part_ = tuple(collected(self.points_, X[rows], Y[rows]) for rows in each)
        return other.resting_on([reduce(Statistics.plus, found) for found in zip(*other.by_part_, strict=True)])

    def inflated(self, inflation: Sequence[float]) -> Self:
        """Return a copy whose posterior, of the same data and hyperparameters, counts so many samples as one.

        Parameters
        ----------
        inflation : sequence of float, for each group of outputs, how many samples count as one
        """
        pairs = zip(self.statistics_, inflation, strict=True)
        other = self.resting_on([replace(statistics, inflation=factor) for statistics, factor in pairs])
        other.inflation = tuple(inflation)
        return other

    def resting_on(self, statistics: Sequence[Statistics]) -> Self:
        """Return a copy whose posterior, under the same points and hyperparameters, is that of other statistics.

        Parameters
        ----------
        statistics : sequence of Statistics, for each group of outputs
        """
        other = copy(self)
        other.statistics_ = tuple(statistics)
        other.predictor_ = resting_on(self.points_, other.statistics_)
        return other

    def _predictor(self, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress) -> Predictor:
        self.jitter_, self.unseen_, self.points_, self.statistics_, self.by_part_ = 0.0, 0.0, (), (), ()
        return super()._predictor(X, Y, rng, progress)

    def _posterior(
        self, learned: Learned, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress
    ) -> SharedPredictor:
        kernel = learned.kernel
        basis = choose_inducing(kernel, X, self.n_inducing, rng)
        L, jitter = cholesky(kernel(basis, basis))
        points = Points(kernel, basis, L, learned.scaling.y_centre, learned.signal, learned.noise, self.n_variance)
        inflation = 1.0 if self.inflation is None else self.inflation[len(self.statistics_)]
        statistics = replace(self._collect(points, X, Y, progress), inflation=inflation)
        self.points_ = (*self.points_, points)
        self.statistics_ = (*self.statistics_, statistics)
        self.jitter_ = max(self.jitter_, jitter)
        self.unseen_ = max(self.unseen_, statistics.unseen(len(basis)))
        return points.posterior(statistics)

    def _collect(self, points: Points, X: FloatArray, Y: FloatArray, progress: Progress) -> Statistics:
        """Return the statistics of all samples; with parts to be left out later, the sum of theirs."""
        if self._parts is None:
            return points.collect(X, Y, progress)
        parts, terms, stride = self._parts
        chosen = [rows[::stride] for rows in parts]
        found = [points.collect(X[rows], Y[rows], progress, terms[rows]).counted(stride) for rows in chosen]
        self.by_part_ = tuple(
            (*before, own) for before, own in zip(self.by_part_ or [()] * len(found), found, strict=True)
        )
        whole = reduce(Statistics.plus, found)
        return replace(whole, Vy=whole.Vy[:, : Y.shape[1]])


def choose_inducing(kernel: Kernel, X: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Return at most `count` rows of `X` `(n, d)` as inducing points; fewer when they explain all the others.

    They are drawn in proportion to what the points chosen so far leave unexplained: randomly pivoted Cholesky (Chen,
    Epperly, Tropp and Webber 2023) in blocks with rejection (Epperly, Tropp and Webber 2024), the same law as drawing
    one at a time at the speed of matrix products. Unlike the greedy choice it does not chase outliers, unlike k-means
    it never puts two points where one will do, so the covariance of the points stays well conditioned; and any first
    part of the points is itself a sound choice, which the predictor makes use of.

    Parameters
    ----------
    kernel : Kernel, in the units of X
    X : (n, d) array, training inputs; a random part of them are candidates
    count : int, points wanted
    rng : numpy.random.Generator, source of the draws
    """
    candidates = X[rng.permutation(len(X))[: max(CANDIDATES_PER_POINT * count, FEWEST_CANDIDATES)]]
    count = min(count, len(candidates))
    factor, left, chosen = np.empty((count, len(candidates))), np.ones(len(candidates)), np.empty(0, dtype=np.int64)
    while len(chosen) < count and left.max() > TOLERANCE:
        found = factor[: len(chosen)]
        batch = np.unique(rng.choice(len(left), min(BLOCK, count - len(chosen)), p=left / left.sum()))
        batch = rng.permutation(batch)
        inner = kernel(candidates[batch], candidates[batch]) - found[:, batch].T @ found[:, batch]
        drawn = _thin(inner, rng)
        rows = batch[drawn]
        cross = kernel(candidates[rows], candidates) - found[:, rows].T @ found
        new = solve_triangular(cholesky(inner[np.ix_(drawn, drawn)])[0], cross, lower=True, check_finite=False)
        factor[len(chosen) : len(chosen) + len(rows)] = new
        left = np.maximum(left - np.einsum("in,in->n", new, new), 0.0)
        left[rows] = 0.0
        chosen = np.concatenate([chosen, rows])
    return candidates[chosen]


def _thin(residual: FloatArray, rng: np.random.Generator) -> IntArray:
    """Keep of a block what drawing one at a time would: each with the share of its variance that is still left."""
    left = np.array(residual)
    thresholds = np.maximum(np.diagonal(residual) * rng.random(len(residual)), TOLERANCE)
    drawn: list[int] = []
    for i, threshold in enumerate(thresholds):
        if left[i, i] > threshold or not drawn:
            drawn.append(i)
            column = left[:, i] / np.sqrt(max(left[i, i], TOLERANCE))
            left -= np.outer(column, column)
    return np.array(drawn, dtype=np.int64)
