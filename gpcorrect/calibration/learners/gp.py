"""Gaussian-process regression, after a linear law where the task has one, with a zero that may move over time.

Poses have no linear law: the regression returns to the registered answer far from the data. Joints have one, for gain,
coupling, friction and slack are linear in their features; the regression takes the smooth field that it leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples, in_order, pieces
from gpcorrect.calibration.learners.learner import Fitted
from gpcorrect.calibration.learners.polynomial import PolynomialMap
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.errors import DataError
from gpcorrect.gpr import LeftOut, Predictor, Statistics, learn_inflation
from gpcorrect.types import FloatArray, IntArray, Progress

if TYPE_CHECKING:
    from gpcorrect.gpr import SparseGPR

FEW = 3  # rows that are asked one by one: a sample of a stream, and both ends of what its past leaves open
FEWEST_STRETCHES = 40
"""Into which a recording is cut for noise that neighbours have in common: a stretch costs its cube; chosen by hand."""
VARIANCE_POINTS = 150
"""Inducing points of variances after a linear law: a stream asks for six joints a sample at 1 kHz; chosen by hand."""
POSE_VARIANCE_POINTS = 250  # the same without one: a pose is asked for one at a time; chosen by hand
ALIKE, ENOUGH_SUMMED = 3, 4000
"""Of a long recording every third sample is summed and judged first, if those are 4000 or more. Where three or more
neighbours are then found to count as one, the others say nothing more (303 reaches of debridement: 2.037 mm and 2.603
deg with every third sample, 2.040 and 2.602 with all); else all are. Chosen by hand; 3 is a step of the inflation."""
GAINS = (0.0, 0.1, 0.2, 0.4, 0.7)  # gains of the local level to choose from; chosen by hand
FEWEST_LEVELS = 8  # trajectories from which a moving zero can be separated from chance; chosen by hand
CLEARLY = 0.95
"""Fraction that squared errors must come under: with a gain above 0 those without motion, with the regression those of
the linear law; chosen by hand."""


@dataclass(frozen=True, eq=False)
class GPMap:
    """A linear law on all inputs where there is one, and a regression on those that may act in a curved way."""

    linear: PolynomialMap | None  # of degree 1
    columns: IntArray  # (k,) inputs of the regression
    predictor: Predictor  # of what the linear law leaves
    statistics: tuple[Statistics, ...]  # what the predictor rests on, a group of targets each: more data can be added

    def __post_init__(self) -> None:
        inputs = self.predictor.tables.origin.shape[1]
        if self.columns.shape != (inputs,) or (self.columns < 0).any():
            raise DataError(f"a regression of {inputs} inputs does not look at columns {self.columns}.")

    @property
    def extrapolates(self) -> bool:
        """Whether there is a linear law, which extrapolates."""
        return self.linear is not None

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`; deviations are those of a new observation. A stream's few rows are compiled."""
        chosen = X[:, self.columns]
        if len(X) <= FEW:
            mean, std, novelty = map(np.array, zip(*map(self.predictor.mean_std, chosen), strict=True))
        else:
            mean, std, novelty = self.predictor.mean_std_batch(chosen)
        return (mean if self.linear is None else self.linear.mean(X) + mean), std, novelty


def learn_gp(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`GPMap`.

    Without a linear law, how many neighbouring samples count as one is chosen on errors at folds of trajectories that
    the regression was not fitted to (:func:`gpcorrect.gpr.learn_inflation`). After one, the regression is used of those
    targets alone whose errors there it clearly lessens.
    """
    from gpcorrect.gpr import SparseGPR  # a scikit-learn estimator; answering needs no scikit-learn

    X, Y = samples.learnable()
    trajectory, time = samples.trajectory[samples.rows], samples.time[samples.rows]
    level, linear, groups = np.zeros(Y.shape), None, trajectory
    zero = terms = None
    if layout.penalties is not None:
        first = PolynomialMap.fit(X, Y, 1, layout.penalties)
        unlevelled = Y - first.mean(X)
        level, zero = _local_level(unlevelled, trajectory)
        linear = PolynomialMap.fit(X, Y - level, 1, layout.penalties)
        # trajectories, cut further into at least so many stretches of the recording
        groups = pieces(np.arange(len(X), dtype=np.float64), trajectory, -(-len(X) // FEWEST_STRETCHES))
        terms = np.column_stack([np.ones(len(X)), linear.scaler.apply(X)])
    left = Y - level - (0.0 if linear is None else linear.mean(X))
    inducing = settings.inducing or layout.inducing
    regressor = SparseGPR(
        n_inducing=inducing,
        n_variance=min(inducing, VARIANCE_POINTS if linear else POSE_VARIANCE_POINTS),
        feature_groups=layout.inputs,
        output_groups=layout.targets,
        random_state=settings.seed,
    )
    regressor.set_params(n_learn=settings.search_samples or regressor.n_learn)
    chosen = X[:, layout.smooth]
    folds = samples.folds
    stride = ALIKE if linear is None and len(X) >= ALIKE * ENOUGH_SUMMED else 1
    regressor.fit_by_parts(chosen, left, folds, terms, stride=stride, groups=groups, times=time, progress=progress)
    if linear is None:
        some = regressor
        regressor, left_out = learn_inflation(some, chosen, left, folds, groups, time, progress, stride)
        if min(regressor.inflation or ()) < stride:
            every = some.with_all(chosen, left, folds)
            regressor, left_out = learn_inflation(every, chosen, left, folds, groups, time, progress)
    else:
        left_out, of_law = _left_out(regressor, linear, X, Y - level, layout, folds)
        useless = (left_out.errors**2).sum(axis=0) > CLEARLY * (of_law**2).sum(axis=0)
        if useless.any():  # what neighbours share and nobody else, a slack's unknown start, is no field
            regressor = regressor.resting_on(_times(regressor, regressor.statistics_, np.diag(~useless)))
            left_out = replace(left_out, errors=np.where(useless, of_law, left_out.errors))
    learned = GPMap(linear, layout.smooth, regressor.predictor_, regressor.statistics_)
    foretold = None if zero is None else _foretold(unlevelled, trajectory, folds, zero)
    return Fitted(learned, replace(left_out, errors=left_out.errors + level), zero, foretold)


def _left_out(
    regressor: SparseGPR, linear: PolynomialMap, X: FloatArray, Y: FloatArray, layout: Layout, folds: IntArray
) -> tuple[LeftOut, FloatArray]:
    """Return what law and regression, both of the other folds, predict of each, and the errors of the law alone.

    Every sample counts: what neighbours share is the law's and the stretches', and counting them as one too took
    joint 6 of a dVRK from 2.07 to 2.19 degrees and its intervals from 94.6 to 91.8 % (bench/joint_compare.py).

    What a posterior rests on is linear in its targets: of each fold it was summed once, for what the law of all leaves
    and for the terms of a linear law, and so holds for what any law leaves.
    """
    errors, of_law, std = np.empty((3, *Y.shape))
    novelty, smooth = np.empty(len(X)), X[:, layout.smooth]
    sums = regressor.by_part_
    for k, fold in enumerate(np.unique(folds)):
        out = folds == fold
        law = PolynomialMap.fit(X[~out], Y[~out], 1, layout.penalties)
        others = [reduce(Statistics.plus, parts) for parts in zip(*(sums[:k] + sums[k + 1 :]), strict=True)]
        leaves = np.vstack([np.eye(Y.shape[1]), linear.weights - law.weights_under(linear.scaler)])
        model = regressor.resting_on(_times(regressor, others, leaves))
        mean, std[out], novelty[out] = model.predictor_.mean_std_batch(smooth[out])
        of_law[out] = Y[out] - law.mean(X[out])
        errors[out] = of_law[out] - mean
    return LeftOut(errors, std, novelty), of_law


def _foretold(errors: FloatArray, trajectory: IntArray, folds: IntArray, zero: FloatArray) -> FloatArray:
    """Return the zero `(n, m)` that the other folds say of each sample's, relative to the mean of all trajectories.

    A model goes on from where its zero stood last, and errs by how far it moves from there.
    """
    means = _means(errors, trajectory)
    foretold = np.zeros(errors.shape)
    for fold in np.unique(folds):
        rest = folds != fold
        others = _means(errors[rest], trajectory[rest])
        foretold[~rest] = others.mean(axis=0) - means.mean(axis=0) + _local_level(errors[rest], trajectory[rest])[1]
    return np.where(zero != 0, foretold, 0.0)


def _means(errors: FloatArray, trajectory: IntArray) -> FloatArray:
    """Return the mean errors `(t, m)` of trajectories, in recorded order."""
    first = np.sort(np.unique(trajectory, return_index=True)[1])
    return np.array([errors[trajectory == name].mean(axis=0) for name in trajectory[first]])


def _times(regressor: SparseGPR, statistics: Sequence[Statistics], factor: FloatArray) -> list[Statistics]:
    """Return the statistics of targets, and of what was summed beside them, times a matrix `(m + k, m)`."""
    targets, found = factor.shape[1], []
    for part, learned in zip(statistics, regressor.learned_, strict=True):
        columns = np.arange(targets)[learned.columns]
        rows = np.concatenate([columns, np.arange(targets, len(factor))])
        found.append(replace(part, Vy=part.Vy @ factor[np.ix_(rows, columns)]))
    return found


def _local_level(errors: FloatArray, trajectory: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the part of errors `(n, m)` that moves between trajectories, and where it stands last, from its mean.

    A local level model of each trajectory's mean: in its steady form (Durbin and Koopman 2012, Sec. 2.1) that is
    exponential smoothing, whose gain is chosen by how well it predicts the next trajectory; 0 for a level that holds
    still.
    """
    means, number = _means(errors, trajectory), in_order(trajectory)
    if len(means) < FEWEST_LEVELS:
        return np.zeros(errors.shape), np.zeros(errors.shape[1])
    columns = [(column, _gain(column)) for column in (means - means.mean(axis=0)).T]
    paths = [(_levels(column, gain), _levels(column[::-1], gain)[::-1]) for column, gain in columns]
    smooth = np.column_stack([(ahead + back) / 2 for ahead, back in paths])
    return smooth[number], np.array([ahead[-1] for ahead, _ in paths])


def _gain(means: FloatArray) -> float:
    """Return the gain that predicts each next mean best; 0 unless it is clearly, and not by chance, better than none.

    By chance: less by no more than a standard error (the rule of Breiman et al. 1984, Sec. 3.4.3). Means of 20
    trajectories that return by themselves (an autoregression of .5) were foretold with 1.15 times the squares of no
    level before, 1.06 with it; those that walk with .59 instead of .51.
    """
    centred = means - means.mean()
    warm = max(2, len(means) // 10)
    squares = []
    for gain in GAINS:
        before = np.append(0.0, _levels(centred, gain)[:-1])
        squares.append((centred[warm:] - before[warm:]) ** 2)
    best = int(np.argmin(np.mean(squares, axis=1)))
    less = squares[0] - squares[best]
    clear = max((1 - CLEARLY) * squares[0].mean(), less.std(ddof=1) / np.sqrt(len(less)))
    return GAINS[best] if less.mean() > clear else 0.0


def _levels(values: FloatArray, gain: float) -> FloatArray:
    """Return exponentially smoothed values `(n,)`, from level 0."""
    level, levels = 0.0, np.empty(len(values))
    for k, value in enumerate(values):
        level += gain * (value - level)
        levels[k] = level
    return levels
