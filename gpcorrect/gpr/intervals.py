"""Deviations and intervals that hold on trajectories never seen, by what left-out trajectories showed.

Samples of one trajectory err together (hysteresis, drift, a tracker's filter), and a posterior that takes each of them
for new evidence follows those errors: the more samples, the closer. How many of them count as one is chosen by what
predicts left-out data best; multiplying the noise is the cheapest remedy that keeps the spectrum shared by all outputs
(docs/design/0002).

Intervals are a conformal calibration of the normalised error `|error| / std` (Lei et al. 2018) with trajectories as the
units that are exchangeable: every trajectory counts alike, and the quantile is raised until left-out trajectories are
covered as promised. Parts of a recording, of many trajectories each, differ too (a zero wanders, cables settle after a
homing): where they do, the interval is as wide as four in five parts to come will need.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.gpr.linalg import cholesky
from gpcorrect.gpr.predictor import SharedPredictor
from gpcorrect.gpr.statistics import Statistics
from gpcorrect.types import FloatArray, IntArray, Progress, frozen_array

if TYPE_CHECKING:
    from gpcorrect.gpr.sparse import SparseGPR


LEVEL = 0.95  # what an interval promises
FOLDS = 10  # of trajectories, that the level is checked on: the usual number, each trajectory left out once
INSIDE = 0.995  # of the left-out training samples: chosen by hand, so that the odd one of them is outside
PARTS_COVERED = 0.8  # of parts to come, that are covered as promised: chosen by hand (bench/joint_intervals.py)
LEAST_NEEDED = 0.1  # of what the part in most need needs, that a part is taken to need: where errors are all but zero
STEPS = 16  # halvings of the level: finer than one sample in 50 000


@dataclass(frozen=True, eq=False)
class IntervalCalibration:
    """How many standard deviations the half width of a 95 % interval is, for every output.

    Parameters
    ----------
    factor : (m,) array, 1.96 where errors are normal and the standard deviations right
    """

    factor: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", frozen_array(self.factor))
        if self.factor.ndim != 1 or not ((self.factor >= 0) & np.isfinite(self.factor)).all():
            raise DataError(f"intervals of {self.factor} standard deviations cannot be.")

    @classmethod
    def fit(cls, errors: FloatArray, std: FloatArray, groups: IntArray, parts: IntArray | None = None) -> Self:
        """Learn the factors from errors at samples that the model did not learn from.

        Parameters
        ----------
        errors, std : (n, m) arrays, errors and the standard deviations predicted for them
        groups : (n,) array, trajectory of each sample
        parts : (n,) array, optional
            Part of the recording that each sample was left out with. With them the intervals allow for how much parts
            differ: 95 % of the samples of a part to come, in four of five parts.

        Raises
        ------
        DataError
            Shapes do not match, there are no samples, or a standard deviation is not positive.
        """
        errors, std = np.asarray(errors, dtype=np.float64), np.asarray(std, dtype=np.float64)
        if errors.shape != std.shape or errors.ndim != 2 or len(errors) != len(groups) or len(errors) == 0:
            raise DataError(
                f"errors and std must be (n, m), groups (n,): got {errors.shape}, {std.shape}, {np.shape(groups)}."
            )
        if not (std > 0).all():
            raise DataError("a standard deviation is not positive.", hint="Predict with noise included.")
        labels: IntArray = np.unique(groups, return_inverse=True)[1]
        scores = np.abs(errors) / std
        factor = np.array([_factor(column, labels) for column in scores.T])
        return cls(factor if parts is None else np.maximum(factor, _needed_by_parts(scores, parts)))

    def widened(self, by: float) -> Self:
        """Return the calibration with all intervals wider by a factor.

        Parameters
        ----------
        by : float
        """
        return type(self)(by * self.factor)

    def interval95(self, std: FloatArray) -> FloatArray:
        """Half widths `(..., m)` of the intervals.

        Parameters
        ----------
        std : (..., m) array
        """
        return std * self.factor


def novelty_limit(novelty: FloatArray) -> float:
    """Novelty below which nearly all left-out training samples lie: a query above it is outside their region.

    Parameters
    ----------
    novelty : (n,) array, of left-out training samples
    """
    return float(np.quantile(novelty, INSIDE))


def _factor(scores: FloatArray, labels: IntArray) -> float:
    """Quantile of the scores `(n,)` at the smallest level that covers left-out groups to 95 %."""
    counts = np.bincount(labels)
    order = np.argsort(scores)
    scores, labels = scores[order], labels[order]
    weights = 1.0 / counts[labels]
    folds = labels % min(FOLDS, len(counts))
    low, high = LEVEL, 1.0
    for _ in range(STEPS if len(counts) > 1 else 0):
        middle = 0.5 * (low + high)
        covered = _covered(scores, weights, folds, middle)
        low, high = (low, middle) if covered >= LEVEL else (middle, high)
    return _quantile(scores, weights, low)


def _needed_by_parts(scores: FloatArray, parts: IntArray) -> FloatArray:
    """Factor `(m,)` that `PARTS_COVERED` of the parts to come need at most, for scores `(n, m)`; 0 for a lone part.

    What parts needed is taken for draws from a log-normal distribution, of which the next is predicted by Student's t.
    """
    from scipy.stats import t as student

    needed = np.array([np.quantile(scores[parts == part], LEVEL, axis=0) for part in np.unique(parts)])
    if (count := len(needed)) < 2:
        return np.zeros(scores.shape[1])
    logs = np.log(np.maximum(needed, LEAST_NEEDED * needed.max(axis=0) + np.finfo(float).tiny))
    beyond = float(student.ppf(PARTS_COVERED, count - 1)) * np.sqrt(1 + 1 / count)
    factor: FloatArray = np.exp(logs.mean(axis=0) + beyond * logs.std(axis=0, ddof=1))
    return factor


def _covered(scores: FloatArray, weights: FloatArray, folds: IntArray, level: float) -> float:
    """Weighted share of each fold below the quantile of the others, over all folds."""
    inside = 0.0
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        limit = _quantile(scores[~out], weights[~out], level)
        inside += float(weights[out][scores[out] <= limit].sum())
    return inside / float(weights.sum())


def _quantile(scores: FloatArray, weights: FloatArray, level: float) -> float:
    """Smallest score that has at least `level` of the weight at or below it; scores come sorted."""
    share = np.cumsum(weights) / weights.sum()
    return float(scores[min(int(np.searchsorted(share, level)), len(scores) - 1)])


INFLATIONS = (1.0, 3.0, 10.0, 30.0)
FEW = 40  # trajectories: of so few each leaves its mark on the hyperparameters, and left out it is still predicted well
JUDGES = 4000  # left-out samples that choose: neighbours err alike, so more of them say little more


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What a model predicts of samples whose fold it was not fitted to.

    Parameters
    ----------
    errors, std : (n, m) arrays, errors, and the standard deviations promised for them
    novelty : (n,) array
    """

    errors: FloatArray
    std: FloatArray
    novelty: FloatArray


def learn_inflation(
    regressor: SparseGPR,
    X: FloatArray,
    Y: FloatArray,
    folds: IntArray,
    groups: IntArray | None = None,
    times: FloatArray | None = None,
    progress: Progress | None = None,
) -> tuple[SparseGPR, LeftOut]:
    """Return a fitted regressor with the inflation that predicts left-out folds best, and what it predicts of them.

    Parameters
    ----------
    regressor : SparseGPR, fitted to X and Y, quickest by the same parts as `folds`; its hyperparameters stay
    X, Y : (n, d) and (n, m) arrays
    folds : (n,) array, which samples are left out together: whole trajectories
    groups, times : (n,) arrays, optional
        Trajectories and times that it was fitted with. Where there are few trajectories, what is said of a left-out one
        comes from hyperparameters that were not learned from it either.
    progress : Progress, optional, updated after each fold

    Raises
    ------
    DataError
        There are fewer than two folds.
    """
    if len(names := np.unique(folds)) < 2:
        raise DataError("leaving samples out needs at least two folds.", hint="Number blocks of time as folds.")
    progress = progress or Progress()
    stride = -(-len(X) // JUDGES)
    without, squares = [], np.zeros((len(INFLATIONS), len(regressor.learned_)))
    few = groups is not None and len(np.unique(groups)) < FEW
    models = _afresh(regressor, X, Y, folds, groups, times) if few else _less(regressor, X, Y, folds)
    for fold, model in zip(names, models, strict=True):
        without.append(model)
        judges = np.flatnonzero(folds == fold)[::stride]
        squares += _squares(model, X[judges], Y[judges])
        progress.step("left-out trajectories", len(without) / len(names))
    inflation = tuple(INFLATIONS[best] for best in squares.argmin(axis=0))
    return regressor.inflated(inflation), _left_out(without, inflation, X, Y, folds)


def _less(regressor: SparseGPR, X: FloatArray, Y: FloatArray, folds: IntArray) -> Iterator[SparseGPR]:
    """Models without each fold, under the hyperparameters and points of all: the sums of all less those of the fold."""
    for k, fold in enumerate(np.unique(folds)):
        parts = regressor.by_part_
        own = parts[k] if parts else regressor.collected(X[folds == fold], Y[folds == fold])
        yield regressor.resting_on([a.minus(b) for a, b in zip(regressor.statistics_, own, strict=True)])


def _afresh(
    regressor: SparseGPR,
    X: FloatArray,
    Y: FloatArray,
    folds: IntArray,
    groups: IntArray | None,
    times: FloatArray | None,
) -> Iterator[SparseGPR]:
    """Models that saw nothing of each fold, hyperparameters and points included; they search among as many fewer."""
    for fold in np.unique(folds):
        rows = folds != fold
        stretches = (None if part is None else part[rows] for part in (groups, times))
        fewer = copy(regressor).set_params(n_learn=round(regressor.n_learn * float(rows.mean())))
        yield fewer.relearn(X[rows], Y[rows], *stretches)


def _squares(model: SparseGPR, X: FloatArray, Y: FloatArray) -> FloatArray:
    """Sum squared errors `(steps, groups)`, every output in its own spread, under each inflation."""
    sums = np.empty((len(INFLATIONS), len(model.learned_)))
    for g, (learned, part, statistics) in enumerate(
        zip(model.learned_, model.predictor_.parts, model.statistics_, strict=True)
    ):
        errors = Y[:, learned.columns] - _means(part, statistics, X)
        sums[:, g] = ((errors / learned.scaling.y_spread) ** 2).sum(axis=(1, 2))
    return sums


def _means(part: SharedPredictor, statistics: Statistics, X: FloatArray) -> FloatArray:
    """Means `(steps, n, m)` under each inflation."""
    L = cholesky(part.kernel(part.basis, part.basis))[0]
    K = part.kernel(X, part.basis)
    ratio = part.noise / part.signal
    tried = [replace(statistics, inflation=inflation) for inflation in INFLATIONS]
    return np.array([K @ one.mean_weights(L, ratio) + part.offset for one in tried])


def _left_out(
    without: Sequence[SparseGPR], inflation: tuple[float, ...], X: FloatArray, Y: FloatArray, folds: IntArray
) -> LeftOut:
    errors, std, novelty = np.empty(Y.shape), np.empty(Y.shape), np.empty(len(X))
    for fold, model in zip(np.unique(folds), without, strict=True):
        rows = folds == fold
        mean, std[rows], novelty[rows] = model.inflated(inflation).predictor_.mean_std_batch(X[rows])
        errors[rows] = Y[rows] - mean
    return LeftOut(errors, std, novelty)
