"""Least median of squares: the fit that the nearer half of the data agrees on (Rousseeuw 1984)."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.stats import chi2

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

__all__ = ["LeastMedianFit", "least_median", "robust_scale", "trials_needed"]

Model = TypeVar("Model")

INLIER_FACTOR = 2.5  # Rousseeuw & Leroy 1987: inliers of the reweighted fit
CONFIDENCE = 0.999
BREAKDOWN = 0.5
REFINED = 5  # candidates that are concentrated, the rest cannot win (Rousseeuw & Van Driessen 2006)
CONCENTRATIONS = 3
TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, eq=False)
class LeastMedianFit(Generic[Model]):
    """What the search found.

    Parameters
    ----------
    model : object
        Refitted on the inliers.
    scales : (parts,) array
        Robust standard deviation of one component of each part of the residual.
    inliers : (n,) bool array
        Samples within 2.5 scales in every part.
    """

    model: Model
    scales: FloatArray
    inliers: BoolArray


def robust_scale(norms: FloatArray, dimension: int = 1, parameters: int = 0) -> FloatArray:
    """Estimate the standard deviation of a component from residual lengths: `c (1 + 5/(n-p)) sqrt(median r^2)`.

    The constant c makes it consistent for Gaussian residuals of `dimension` components: 1.4826 for one
    (Rousseeuw & Leroy 1987, Ch. 5), 0.6501 for three.

    Parameters
    ----------
    norms : (n,) or (n, parts) array
        Lengths of residuals.
    dimension : int
        Components that each residual has.
    parameters : int
        p, the parameters fitted.

    Returns
    -------
    () or (parts,) array
    """
    consistency = 1.0 / math.sqrt(float(chi2.ppf(0.5, dimension)))
    small_sample = 1.0 + 5.0 / max(1, len(norms) - parameters)
    scale: FloatArray = np.asarray(consistency * small_sample * np.sqrt(np.median(norms**2, axis=0)))
    return scale


def trials_needed(sample_size: int, breakdown: float = BREAKDOWN, confidence: float = CONFIDENCE) -> int:
    """Random samples until one is free of outliers with this confidence: `log(1-c) / log(1-(1-e)^m)`."""
    clean = (1.0 - breakdown) ** sample_size
    return max(1, math.ceil(math.log(1.0 - confidence) / math.log1p(-clean)))


def least_median(
    fit: Callable[[IntArray], Model],
    norms: Callable[[Model], FloatArray],
    n: int,
    *,
    sample_size: int,
    rng: np.random.Generator,
    dimension: int = 1,
    floor: float = TINY,
) -> LeastMedianFit[Model]:
    """Search the model whose median squared residual is least, then refit it on its inliers.

    Models are fitted to random samples; the best few are concentrated on the half of the data nearest to them; the
    residual's parts (metres, radians) are weighed by the product of their medians, which no change of unit alters.
    Up to half of the data may be arbitrarily wrong.

    Parameters
    ----------
    fit : callable of (m,) row numbers
        Model of these rows; may raise DegenerateError.
    norms : callable of model
        Residual lengths (n, parts) of all rows.
    n : int
        Number of rows.
    sample_size : int
        Rows in a random sample: as few as determine a model.
    rng : numpy Generator
        Source of the samples.
    dimension : int
        Components of each part of the residual.
    floor : float
        Residuals below it count as equal.

    Raises
    ------
    DataError
        Fewer rows than a sample needs.
    DegenerateError
        No sample determined a model.
    """
    if n < sample_size:
        raise DataError(f"least median of squares needs at least {sample_size} samples, got {n}.")
    candidates = _candidates(fit, norms, n, sample_size, rng, floor)
    best = min((_concentrated(fit, norms, model, n, floor) for _, model in candidates[:REFINED]), key=lambda c: c[0])[1]
    return _reweighted(fit, norms, best, sample_size, dimension, floor)


def _objective(norms: FloatArray, floor: float) -> float:
    return float(np.log(np.maximum(np.median(norms, axis=0), floor)).sum())


def _candidates(
    fit: Callable[[IntArray], Model],
    norms: Callable[[Model], FloatArray],
    n: int,
    sample_size: int,
    rng: np.random.Generator,
    floor: float,
) -> list[tuple[float, Model]]:
    found: list[tuple[float, Model]] = []
    reason = ""
    for _ in range(trials_needed(sample_size)):
        try:
            model = fit(rng.choice(n, sample_size, replace=False))
        except DegenerateError as error:
            reason = str(error)
            continue
        found.append((_objective(norms(model), floor), model))
    if not found:
        raise DegenerateError(f"no sample of {sample_size} determines a model: {reason}")
    return sorted(found, key=lambda candidate: candidate[0])


def _concentrated(
    fit: Callable[[IntArray], Model], norms: Callable[[Model], FloatArray], model: Model, n: int, floor: float
) -> tuple[float, Model]:
    """Refit on the nearer half until the objective stops falling: it never rises for one part."""
    lengths = norms(model)
    objective = _objective(lengths, floor)
    for _ in range(CONCENTRATIONS):
        distance = (lengths / np.maximum(np.median(lengths, axis=0), floor)).max(axis=1)
        try:
            nearer = fit(np.sort(np.argsort(distance, kind="stable")[: n // 2 + 1]))
        except DegenerateError:
            break
        lengths = norms(nearer)
        if not _objective(lengths, floor) < objective:
            break
        objective, model = _objective(lengths, floor), nearer
    return objective, model


def _reweighted(
    fit: Callable[[IntArray], Model],
    norms: Callable[[Model], FloatArray],
    model: Model,
    parameters: int,
    dimension: int,
    floor: float,
) -> LeastMedianFit[Model]:
    """Fit once more on all samples within 2.5 robust scales, where least squares is efficient."""

    def judged(model: Model) -> tuple[FloatArray, BoolArray]:
        lengths = norms(model)
        scales = np.maximum(robust_scale(lengths, dimension, parameters), floor)
        # A vector is an inlier when its length is plausible for its number of components.
        limit = math.sqrt(float(chi2.ppf(chi2.cdf(INLIER_FACTOR**2, 1), dimension)))
        inliers: BoolArray = np.all(lengths <= limit * scales, axis=1)
        return scales, inliers

    _, inliers = judged(model)
    with suppress(DegenerateError):
        model = fit(np.flatnonzero(inliers))
    scales, inliers = judged(model)
    return LeastMedianFit(model, frozen_array(scales), inliers)
