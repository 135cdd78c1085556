"""What a learner is: samples in, a map from inputs to targets out, and what it predicts of samples it did not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.gpr import LeftOut
from gpcorrect.types import FloatArray, Progress


class TargetMap(Protocol):
    """What was learned, as a frozen dataclass that a model file can hold."""

    @property
    def extrapolates(self) -> bool:
        """Whether it extrapolates outside its training inputs, so that inputs are clipped to their range."""
        ...

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return means and standard deviations `(n, m)` and novelties `(n,)`.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        ...


@dataclass(frozen=True, eq=False)
class Fitted:
    """What a learner returns."""

    learned: Any  # TargetMap or CableModel: from inputs, or a whole path, to targets
    # errors, standard deviations and novelties at the samples that may be learned from, each predicted without its own
    # fold, zeros that move over time taken for still
    left_out: LeftOut
    zero: FloatArray | None = None  # (m,) where zeros that move over time stood last; None for those that hold still
    # (n, m) where the other folds say that they stood at these samples; None for those that hold still
    foretold: FloatArray | None = None

    def judged(self) -> LeftOut:
        """Return the errors at left-out samples with zeros where the other folds say: those that an answer makes."""
        left_out = self.left_out
        return left_out if self.foretold is None else replace(left_out, errors=left_out.errors - self.foretold)


Learner = Callable[[Samples, Layout, FitSettings, Progress], Fitted]
"""Learns from the usable samples; raises DataError where they are too few, or the task lacks what it needs."""


def fitted(learn: Callable[[Samples], TargetMap], samples: Samples, folds: int) -> Fitted:
    """Return a map of all usable samples, with predictions by maps that were not fitted to them.

    Parameters
    ----------
    learn, samples, folds
        As for :func:`cross_predicted`.
    """
    return Fitted(learn(samples), cross_predicted(learn, samples, folds))


def cross_predicted(learn: Callable[[Samples], TargetMap], samples: Samples, folds: int) -> LeftOut:
    """Return predictions of the usable samples by maps that were not fitted to them.

    Parameters
    ----------
    learn : callable, from samples to a map
    samples : Samples, whose usable rows are predicted, neighbouring trajectories, or sessions, left out together
    folds : int
        How many parts are left out in turn; with 1 only the last of four is, and the errors are of that part alone.
    """
    rows = samples.rows
    labels = samples.folds
    errors, std = np.full((2, len(rows), samples.target.shape[1]), np.nan)
    novelty = np.zeros(len(rows))
    for fold in np.unique(labels)[-folds:]:
        out = labels == fold
        learned = learn(samples.without(rows[out]))
        mean, std[out], novelty[out] = learned.predict(samples.X[rows[out]])
        errors[out] = samples.target[rows[out]] - mean
    return LeftOut(errors, std, novelty)
