"""Robust weights: registration must stand before cleaning is finished, so gross errors may not steer it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from gpcorrect.rigid.model import RigidModel
from gpcorrect.rigid.residuals import pose_residual
from gpcorrect.types import FloatArray, IntArray, PoseSignal

__all__ = ["cauchy_loss", "cauchy_weights", "evenly_spaced", "fit_robustly", "robust_scale"]

WIDTH = 3.0  # standard deviations at which a sample counts half
MEDIAN_NORM = 1.5381722544550522  # median length of a 3-vector of unit normals: sqrt(chi2.ppf(0.5, 3))
MAX_SAMPLES = 2000  # a dozen unknowns are no better known from more: neighbours in time repeat each other
MAX_ROUNDS = 40
TOLERANCE = 1e-7
FLOOR = 1e-12  # m or rad: exact data leave no scale to divide by


class RigidFit(Protocol):
    """A least-squares registration that takes weights, such as :func:`~gpcorrect.rigid.fit_pose`."""

    def __call__(self, observed: PoseSignal, command: PoseSignal, *, weights: FloatArray | None = None) -> RigidModel:
        """Return the model of least weighted squared error."""
        ...


def robust_scale(norms: FloatArray) -> float:
    """Return the standard deviation of a component, from the lengths `(n,)` of 3-vectors (median)."""
    return max(float(np.median(norms)) / MEDIAN_NORM, FLOOR)


def cauchy_weights(norms: FloatArray, scale: float) -> FloatArray:
    """Weights `(n,)` in (0, 1] of residual lengths: those of the Cauchy loss, a half at WIDTH scales."""
    weights: FloatArray = 1.0 / (1.0 + (norms / (WIDTH * scale)) ** 2)
    return weights


def cauchy_loss(norms: FloatArray, scale: float) -> float:
    """Sum of the loss whose weights :func:`cauchy_weights` are: `WIDTH^2 log(1 + (r / (WIDTH scale))^2)`."""
    return float(WIDTH**2 * np.log1p((norms / (WIDTH * scale)) ** 2).sum())


def evenly_spaced(n: int, most: int = MAX_SAMPLES) -> IntArray:
    """Rows of at most `most` of n samples, spread evenly over the recording."""
    rows: IntArray = np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))
    return rows


def fit_robustly(fit: RigidFit, observed: PoseSignal, command: PoseSignal) -> RigidModel:
    """Registration of least Cauchy loss by reweighting `fit`, started from equal weights.

    A sample's weight is the smaller of those of its position and its rotation, each on its own robust scale.
    """
    rows = evenly_spaced(len(observed))
    observed, command = observed[rows], command[rows]
    model = fit(observed, command)
    weights = np.ones(len(observed))
    for _ in range(MAX_ROUNDS):
        previous, weights = weights, _sample_weights(model, observed, command)
        model = fit(observed, command, weights=weights)
        if np.abs(weights - previous).max() < TOLERANCE:
            break
    return model


def _sample_weights(model: RigidModel, observed: PoseSignal, command: PoseSignal) -> FloatArray:
    residual = pose_residual(model.apply(observed), command)
    parts = (residual[:, :3],) if model.kind == "position" else (residual[:, :3], residual[:, 3:])
    norms = [np.linalg.norm(part, axis=1) for part in parts]
    weights: FloatArray = np.min([cauchy_weights(r, robust_scale(r)) for r in norms], axis=0)
    return weights
