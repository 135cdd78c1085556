"""Least median of squares: the fit that the nearer half of the data agrees on (Rousseeuw 1984)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.special import chdtr
from scipy.special import chdtri as chi2_upper

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import RigidModel, fit_pose, fit_position
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.robust import robust_scale
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal, frozen_array

Model = TypeVar("Model")

INLIER_FACTOR = 2.5  # Rousseeuw & Leroy 1987: inliers of the reweighted fit
CONFIDENCE = 0.999  # that one random sample at least is free of outliers: one recording in a thousand may go wrong
BREAKDOWN = 0.5  # fraction of outliers that the number of random samples is made for: the most that any fit bears
REFINED = 5  # candidates that are concentrated, the rest cannot win (Rousseeuw & Van Driessen 2006)
CONCENTRATIONS = 3  # Rousseeuw & Van Driessen 2006 take two; the objective stops falling by itself
TINY = np.finfo(np.float64).tiny
POSE_SAMPLE = 4  # one more than positions need: orientations are then determined too
STACK = 64  # planes measured at once: what is worked on stays in the processor's cache; changes the speed only
MOST_POSES = 1000  # neighbours in time repeat each other
# m^2: orientation errors of ten degrees weigh as much as positions that are 5 mm off, as cable-driven arms have both.
ROTATION_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class LeastMedian(Generic[Model]):
    """Search for the model whose median squared residual is least, refitted on its inliers.

    Models are fitted to random samples; the best few are concentrated on the half of the data nearest to them; the
    groups of the residual (metres, radians) are weighed by the product of their medians. Up to half of the data may be
    arbitrarily wrong.

    Parameters
    ----------
    fit : callable of (m,) row numbers, model of these rows; may raise DegenerateError
    lengths : callable of model, residual lengths (n, g) of all rows, in g groups
    n : int, number of rows
    sample_size : int, rows in a random sample: as few as determine a model
    dimension : int, components of each group of the residual
    floor : (g,) array or float, residuals below it count as equal
    fit_stack : callable of (k, sample_size) row numbers, optional
        Models of k random samples, and their median residual lengths (k, g), where all at once is quicker.
    """

    fit: Callable[[IntArray], Model]
    lengths: Callable[[Model], FloatArray]
    n: int
    sample_size: int
    dimension: int = 1
    floor: FloatArray | float = TINY
    fit_stack: Callable[[IntArray], tuple[Sequence[Model], FloatArray]] | None = None

    def search(self, rng: np.random.Generator) -> tuple[Model, FloatArray]:
        """Return the model, and robust standard deviations (g,) of one component of each group of the residual.

        Parameters
        ----------
        rng : numpy Generator, source of the samples

        Raises
        ------
        DataError
            Fewer rows than a sample needs.
        DegenerateError
            No sample determined a model.
        """
        if self.n < self.sample_size:
            raise DataError(f"least median of squares needs at least {self.sample_size} samples, got {self.n}.")
        candidates = self._candidates(rng)
        best = min((self._concentrated(model) for model in candidates[:REFINED]), key=lambda c: c[0])[1]
        _, inliers = self._inliers(best)
        with suppress(DegenerateError):
            best = self.fit(np.flatnonzero(inliers))
        return best, frozen_array(self._inliers(best)[0])

    def _objective(self, medians: FloatArray) -> FloatArray:
        """Logarithm `(...)` of the product of the groups' medians `(..., g)`, which no change of unit alters."""
        return np.asarray(np.log(np.maximum(medians, self.floor)).sum(axis=-1))

    def _candidates(self, rng: np.random.Generator) -> list[Model]:
        """Fits to random samples, the best first."""
        clean = (1.0 - BREAKDOWN) ** self.sample_size
        count = max(1, math.ceil(math.log(1.0 - CONFIDENCE) / math.log1p(-clean)))
        drawn = np.array([rng.choice(self.n, self.sample_size, replace=False) for _ in range(count)])
        models, medians = self._one_by_one(drawn) if self.fit_stack is None else self.fit_stack(drawn)
        return [models[k] for k in np.argsort(self._objective(medians), kind="stable")]

    def _one_by_one(self, drawn: IntArray) -> tuple[list[Model], FloatArray]:
        """Models of those samples `(k, s)` that determine one, and their median lengths."""
        models, medians, reason = [], [], ""
        for rows in drawn:
            try:
                model = self.fit(rows)
            except DegenerateError as error:
                reason = str(error)
                continue
            models.append(model)
            medians.append(np.median(self.lengths(model), axis=0))
        if not models:
            raise DegenerateError(f"no sample of {self.sample_size} determines a model: {reason}")
        return models, np.array(medians)

    def _concentrated(self, model: Model) -> tuple[float, Model]:
        """Refit on the nearer half until the objective stops falling: it never rises for one group."""
        lengths = self.lengths(model)
        medians = np.median(lengths, axis=0)
        for _ in range(CONCENTRATIONS):
            distance = (lengths / np.maximum(medians, self.floor)).max(axis=1)
            try:
                nearer = self.fit(np.sort(np.argsort(distance, kind="stable")[: self.n // 2 + 1]))
            except DegenerateError:
                break
            lengths = self.lengths(nearer)
            closer = np.median(lengths, axis=0)
            if not self._objective(closer) < self._objective(medians):
                break
            medians, model = closer, nearer
        return float(self._objective(medians)), model

    def _inliers(self, model: Model) -> tuple[FloatArray, BoolArray]:
        """Robust scales (g,), and the samples (n,) whose residual is plausible for its number of components."""
        lengths = self.lengths(model)
        small_sample = 1.0 + 5.0 / max(1, self.n - self.sample_size)  # Rousseeuw & Leroy 1987, Ch. 5
        scales = np.maximum(small_sample * robust_scale(lengths, self.dimension), self.floor)
        limit = math.sqrt(float(chi2_upper(self.dimension, 1.0 - chdtr(1, INLIER_FACTOR**2))))
        return scales, np.all(lengths <= limit * scales, axis=1)


def least_median_plane(X: FloatArray, Y: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return slopes and level (d + 1, m) of the hyperplane that half of the samples agrees on, and its scale (1,).

    Parameters
    ----------
    X : (n, d) array, inputs
    Y : (n, m) array, outputs, one group
    rng : numpy Generator, source of the random samples
    """
    design = np.hstack([X, np.ones((len(X), 1))])

    def plane(rows: IntArray) -> FloatArray:
        return np.asarray(np.linalg.lstsq(design[rows], Y[rows], rcond=None)[0], dtype=np.float64)

    def planes(drawn: IntArray) -> tuple[list[FloatArray], FloatArray]:
        models = np.linalg.pinv(design[drawn]) @ Y[drawn]
        stacks = np.array_split(models, -(-len(models) // STACK))
        medians = [np.median(np.linalg.norm(Y - design @ part, axis=2), axis=1) for part in stacks]
        return list(models), np.concatenate(medians)[:, None]

    search = LeastMedian(
        plane,
        lambda model: np.linalg.norm(Y - design @ model, axis=1, keepdims=True),
        len(X),
        sample_size=min(len(X), design.shape[1]),
        dimension=Y.shape[1],
        fit_stack=planes,
    )
    return search.search(rng)


def least_median_pose(
    observed: PoseSignal, command: PoseSignal, resolution: FloatArray, rng: np.random.Generator
) -> tuple[RigidModel, FloatArray]:
    """Return the registration that half of the poses agrees on, and its scales (g,) (Mahler 2014, Sec. IV-A).

    Parameters
    ----------
    observed, command : PoseSignal, n complete samples; both with orientations where orientations are to count
    resolution : (g,) array, smallest scales: m, and rad where there are orientations
    rng : numpy Generator, source of the random samples

    Raises
    ------
    DataError
        Fewer than four samples.
    DegenerateError
        No random sample determines a registration.
    """
    rows = evenly_spaced(len(observed), MOST_POSES)
    observed, command = observed[rows], command[rows]

    def registration(few: IntArray) -> RigidModel:
        if len(resolution) == 1:
            return fit_position(observed[few], command[few])
        return fit_pose(observed[few], command[few], rotation_weight=ROTATION_WEIGHT)

    # The trace of R_cmd^T R_left R_obs is linear in R_left: a candidate's angles are one product.
    traces = None
    if len(resolution) > 1 and observed.quaternion is not None and command.quaternion is not None:
        R_obs, R_cmd = map(se3.matrix_from_quaternion, (observed.quaternion, command.quaternion))
        traces = (R_cmd @ np.swapaxes(R_obs, -1, -2)).reshape(-1, 9)

    def lengths(rigid: RigidModel) -> FloatArray:
        away = [np.linalg.norm(observed.position @ rigid.R_position.T + rigid.t - command.position, axis=1)]
        if traces is not None:
            away.append(np.arccos(np.clip((traces @ rigid.R_left.ravel() - 1.0) / 2.0, -1.0, 1.0)))
        return np.stack(away, axis=1)

    return LeastMedian(registration, lengths, len(rows), POSE_SAMPLE, dimension=3, floor=resolution).search(rng)
