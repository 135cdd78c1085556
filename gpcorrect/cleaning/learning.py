"""Learns the smooth model of the error from a recording that still holds faults.

Three things keep faults out: the start is the trend of least median of squares; a stretch of the recording is
predicted from the *other* stretches only, so that a long block of faults cannot vouch for itself; and samples far from
their prediction are left out of the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.cleaning.field import ErrorField, Kernel
from gpcorrect.cleaning.inputs import FieldInputs, commanded_twists
from gpcorrect.cleaning.lmeds import robust_scale
from gpcorrect.cleaning.regressor import LeastMedianOfSquares
from gpcorrect.cleaning.samples import Samples, part_norms, small_sample_factor
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.smooth import SecondLook, SmoothModel, judged_rows, scaled_remainder, trend_inputs
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

__all__ = ["evenly_spaced", "learn_smooth_model"]

FOLDS = 10
SEARCH_SAMPLES = 300
ROUNDS = 2
TINY = 1e-12
GRID = {"length": (0.5, 1.0, 2.0, 4.0, 8.0), "noise": (1e-3, 1e-2, 1e-1), "velocity": (0.3, 1.0, 3.0)}


@dataclass(frozen=True, eq=False)
class _Data:
    """Scaled inputs and errors of some samples, and the fold that each lies in."""

    pose: FloatArray
    velocity: FloatArray
    left: FloatArray
    fold: IntArray

    def __getitem__(self, rows: IntArray | BoolArray) -> _Data:
        return _Data(self.pose[rows], self.velocity[rows], self.left[rows], self.fold[rows])


def learn_smooth_model(
    samples: Samples, trusted: BoolArray, settings: CleaningSettings, rng: np.random.Generator
) -> tuple[SmoothModel, SecondLook]:
    """Model from the trusted samples, and how every sample looks beside what the other folds predict for it.

    Parameters
    ----------
    samples : Samples
        n samples, faults among them.
    trusted : (n,) bool array
        False for samples that broke a limit.
    settings : CleaningSettings
        Factors and floors.
    rng : numpy Generator
        Source of the random samples of the trend.
    """
    twist = commanded_twists(samples)
    trend, unit = _trend(samples, twist, trusted, settings, rng)
    scaling = FieldInputs.learn(samples, twist)
    data = _Data(*scaling.transform(samples, twist), scaled_remainder(samples, twist, trend, unit), folds(samples))
    train, kernel = _confirmed_training(data, trusted, settings)
    rows = judged_rows(samples)
    mean, deviation = _cross_predict(train, data[rows], kernel)
    chosen = np.isin(rows, np.flatnonzero(trusted))
    lengths = part_norms(data.left[rows] - mean) / deviation[:, None]
    scale = robust_scale(lengths[chosen], 3) * small_sample_factor(samples)
    scale = np.maximum(scale, settings.resolution[: len(unit)] / unit)
    field = ErrorField(kernel.inputs(train.pose, train.velocity), train.left, kernel)
    model = SmoothModel(scaling, trend, unit, field, frozen_array(scale))
    others = model.beside(data.left, rows, mean, deviation)
    return model, replace(others, along=model.look(samples).remainder)


def evenly_spaced(rows: IntArray, most: int) -> IntArray:
    """At most `most` of the rows, evenly spread over the recording."""
    chosen: IntArray = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(np.int64))]
    return chosen


def folds(samples: Samples) -> IntArray:
    """Fold (n,) of each sample: stretches of consecutive whole trajectories, or of time where there are few of them."""
    starts = np.concatenate([[0], np.cumsum(np.diff(samples.trajectory) != 0)])
    if starts[-1] + 1 >= FOLDS:
        by_trajectory: IntArray = starts * FOLDS // (starts[-1] + 1)
        return by_trajectory
    return np.arange(len(samples)) * FOLDS // len(samples)


def _trend(
    samples: Samples, twist: FloatArray, trusted: BoolArray, settings: CleaningSettings, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Slopes and level (7, k) of the error over commanded positions and velocities, and spread (parts,) about them."""
    rows = evenly_spaced(np.flatnonzero(trusted), settings.field_samples)
    trends, units = [], []
    parts = np.split(samples.error, samples.error.shape[1] // 3, axis=1)
    for k, (part, resolution) in enumerate(zip(parts, settings.resolution, strict=False)):
        plane = LeastMedianOfSquares(random_state=int(rng.integers(2**31 - 1)))
        plane.fit(trend_inputs(samples, twist, k)[rows], part[rows])
        trends.append(np.vstack([plane.coef_.T, plane.intercept_]))
        units.append(max(plane.scale_, resolution))
    return frozen_array(np.hstack(trends)), frozen_array(units)


def _confirmed_training(data: _Data, trusted: BoolArray, settings: CleaningSettings) -> tuple[_Data, Kernel]:
    """Training samples that the model of the other folds confirms, and the kernel that predicts them best."""
    train = data[evenly_spaced(np.flatnonzero(trusted), settings.field_samples)]
    confirmed: BoolArray = np.all(part_norms(train.left) <= settings.offset_factor, axis=1)
    kernel = _best_kernel(train[confirmed])
    for _ in range(ROUNDS):
        mean, deviation = _cross_predict(train[confirmed], train, kernel)
        lengths = part_norms(train.left - mean) / deviation[:, None]
        confirmed = np.all(lengths <= settings.offset_factor * np.maximum(robust_scale(lengths, 3), TINY), axis=1)
    return train[confirmed], kernel


def _cross_predict(train: _Data, asked: _Data, kernel: Kernel) -> tuple[FloatArray, FloatArray]:
    """Mean (n, k) and deviation (n,) at the asked samples, each from the training samples of the other folds."""
    mean, deviation = np.zeros(asked.left.shape), np.ones(len(asked.left))
    for fold in np.unique(asked.fold):
        others, here = train.fold != fold, asked.fold == fold
        field = ErrorField(kernel.inputs(train.pose[others], train.velocity[others]), train.left[others], kernel)
        mean[here], deviation[here] = field.predict(kernel.inputs(asked.pose[here], asked.velocity[here]))
    return mean, deviation


def _best_kernel(train: _Data) -> Kernel:
    """Kernel of least median error on the other folds, one parameter after the other."""
    few = train[evenly_spaced(np.arange(len(train.left)), SEARCH_SAMPLES)]
    best = Kernel()
    for name, values in GRID.items():
        kernels = [replace(best, **{name: value}) for value in values]
        best = min(kernels, key=lambda kernel: _median_error(few, kernel))
    return best


def _median_error(data: _Data, kernel: Kernel) -> float:
    lengths = part_norms(data.left - _cross_predict(data, data, kernel)[0])
    return float(np.log(np.maximum(np.median(lengths, axis=0), TINY)).sum())
