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
from scipy.special import stdtrit

from gpcorrect.errors import DataError
from gpcorrect.gpr.statistics import Statistics, collected
from gpcorrect.types import FloatArray, IntArray, Progress, frozen_array

if TYPE_CHECKING:
    from gpcorrect.gpr.sparse import SparseGPR

    _Without = tuple[SparseGPR, Sequence[Statistics]]
    """A model whose points and hyperparameters stand, and what it rests on without a fold."""


LEVEL = 0.95  # what an interval promises
FOLDS = 10  # of trajectories, that the level is checked on: the usual number, each trajectory left out once
INSIDE = 0.995  # of the left-out training samples: chosen by hand, so that the odd one of them is outside
PARTS_COVERED = 0.8  # of parts to come, that are covered as promised: chosen by hand (bench/joint_intervals.py)
LEAST_NEEDED = 0.1  # of what the part in most need needs, that a part is taken to need: where errors are all but zero
STEPS = 16  # halvings of the level: finer than one sample in 50 000
INFLATIONS = (1.0, 3.0, 10.0, 30.0)
FEW = 40  # trajectories: of so few each leaves its mark on the hyperparameters, and left out it is still predicted well
JUDGES = 4000  # left-out samples that choose: neighbours err alike, so more of them say little more


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

    def widened(self, by: float | FloatArray) -> Self:
        """Return the calibration with all intervals wider by a factor.

        Parameters
        ----------
        by : float or (m,) array
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
    novelty : (n,) array, of left-out training samples; NaN where unknown
    """
    return float(np.nanquantile(novelty, INSIDE))


def _factor(scores: FloatArray, labels: IntArray) -> float:
    """Quantile of the scores `(n,)` at the smallest level that covers left-out groups to 95 %."""
    counts = np.bincount(labels)
    order = np.argsort(scores)
    scores, labels = scores[order], labels[order]
    weights = 1.0 / counts[labels]
    folds = labels % min(FOLDS, len(counts))
    left_out = [folds == fold for fold in range(int(folds.max()) + 1)] if len(counts) > 1 else []
    # Sorted scores, and the weight of all up to each: of a fold, and of the others.
    parts = [((scores[out], np.cumsum(weights[out])), (scores[~out], np.cumsum(weights[~out]))) for out in left_out]
    low, high = LEVEL, 1.0
    for _ in range(STEPS if parts else 0):
        middle = 0.5 * (low + high)
        covered = sum(_weight_within(*own, _quantile(*others, middle)) for own, others in parts) / float(weights.sum())
        low, high = (low, middle) if covered >= LEVEL else (middle, high)
    return _quantile(scores, np.cumsum(weights), low)


def _quantile(scores: FloatArray, weight: FloatArray, level: float) -> float:
    """Smallest of sorted scores that has at least `level` of the weight at or below it."""
    return float(scores[min(int(np.searchsorted(weight / weight[-1], level)), len(scores) - 1)])


def _weight_within(scores: FloatArray, weight: FloatArray, limit: float) -> float:
    """Weight of the sorted scores at or below a limit."""
    count = int(np.searchsorted(scores, limit, side="right"))
    return float(weight[count - 1]) if count else 0.0


def _needed_by_parts(scores: FloatArray, parts: IntArray) -> FloatArray:
    """Factor `(m,)` that `PARTS_COVERED` of the parts to come need at most, for scores `(n, m)`; 0 for a lone part.

    What parts needed is taken for draws from a log-normal distribution, of which the next is predicted by Student's t.
    """
    needed = np.array([np.quantile(scores[parts == part], LEVEL, axis=0) for part in np.unique(parts)])
    if (count := len(needed)) < 2:
        return np.zeros(scores.shape[1])
    logs = np.log(np.maximum(needed, LEAST_NEEDED * needed.max(axis=0) + np.finfo(float).tiny))
    beyond = float(stdtrit(count - 1, PARTS_COVERED)) * np.sqrt(1 + 1 / count)
    return np.asarray(np.exp(logs.mean(axis=0) + beyond * logs.std(axis=0, ddof=1)))


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What a model predicts of samples whose fold it was not fitted to.

    Parameters
    ----------
    errors, std : (n, m) arrays, errors, and the standard deviations promised for them; NaN where nothing was predicted
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
    stride: int = 1,
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
    stride : int, every so-manieth sample of a fold is predicted, the others are NaN: where neighbours err alike

    Raises
    ------
    DataError
        There are fewer than two folds.
    """
    if len(names := np.unique(folds)) < 2:
        raise DataError("leaving samples out needs at least two folds.", hint="Number blocks of time as folds.")
    progress = progress or Progress()
    few = groups is not None and len(np.unique(groups)) < FEW
    without = []
    for model in _afresh(regressor, X, Y, folds, groups, times) if few else _less(regressor, X, Y, folds):
        without.append(model)
        progress.step("left-out trajectories", len(without) / len(names))
    judges = [np.flatnonzero(folds == name)[:: -(-len(X) // JUDGES)] for name in names]
    inflation = tuple(_best_inflation(without, group, X, Y, judges) for group in range(len(regressor.learned_)))
    judged = [np.flatnonzero(folds == name)[::stride] for name in names]
    return regressor.inflated(inflation), _left_out(without, inflation, X, Y, judged)


def _less(regressor: SparseGPR, X: FloatArray, Y: FloatArray, folds: IntArray) -> Iterator[_Without]:
    """Models without each fold, under the hyperparameters and points of all: the sums of all less those of the fold."""
    for k, fold in enumerate(np.unique(folds)):
        parts = regressor.by_part_
        own = parts[k] if parts else collected(regressor.points_, X[folds == fold], Y[folds == fold])
        yield regressor, [a.minus(b) for a, b in zip(regressor.statistics_, own, strict=True)]


def _afresh(
    regressor: SparseGPR,
    X: FloatArray,
    Y: FloatArray,
    folds: IntArray,
    groups: IntArray | None,
    times: FloatArray | None,
) -> Iterator[_Without]:
    """Models that saw nothing of each fold, hyperparameters and points included; they search among as many fewer."""
    for fold in np.unique(folds):
        rows = folds != fold
        stretches = (None if part is None else part[rows] for part in (groups, times))
        fewer = copy(regressor).set_params(n_learn=round(regressor.n_learn * float(rows.mean())))
        model = fewer.relearn(X[rows], Y[rows], *stretches)
        yield model, model.statistics_


def _best_inflation(
    without: Sequence[_Without], group: int, X: FloatArray, Y: FloatArray, judges: Sequence[IntArray]
) -> float:
    """Inflation of least squared error of a group's outputs, each in its own spread, at the judges of left-out folds.

    From the middle of the list on larger ones are tried while they are better, or else smaller ones.
    """
    asked = []
    for (model, rest), rows in zip(without, judges, strict=True):
        points, learned = model.points_[group], model.learned_[group]
        spread = learned.scaling.y_spread
        left = (Y[rows, learned.columns] - points.offset) / spread
        asked.append((points, rest[group], points.kernel(X[rows], points.basis), left, spread))

    def squares(inflation: float) -> float:
        total = 0.0
        for points, statistics, K, left, spread in asked:
            weights = replace(statistics, inflation=inflation).mean_weights(points.L, points.noise / points.signal)
            total += float(((left - K @ weights / spread) ** 2).sum())
        return total

    middle = len(INFLATIONS) // 2
    first, least = INFLATIONS[middle], squares(INFLATIONS[middle])
    for further in (INFLATIONS[middle + 1 :], INFLATIONS[:middle][::-1]):
        best = first
        for inflation in further:
            if (found := squares(inflation)) >= least:
                break
            best, least = inflation, found
        if best != first:
            return best
    return first


def _left_out(
    without: Sequence[_Without], inflation: tuple[float, ...], X: FloatArray, Y: FloatArray, judged: Sequence[IntArray]
) -> LeftOut:
    errors, std, novelty = np.full(Y.shape, np.nan), np.full(Y.shape, np.nan), np.full(len(X), np.nan)
    for rows, (model, statistics) in zip(judged, without, strict=True):
        inflated = [replace(own, inflation=factor) for own, factor in zip(statistics, inflation, strict=True)]
        mean, std[rows], novelty[rows] = model.resting_on(inflated).predictor_.mean_std_batch(X[rows])
        errors[rows] = Y[rows] - mean
    return LeftOut(errors, std, novelty)
