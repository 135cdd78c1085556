"""Planted residual fields that several tests of the regression share."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray, IntArray

LENGTH_SCALES = np.array([0.8, 1.6, 6.0])


def smooth_field(X: FloatArray, rng: np.random.Generator, outputs: int = 2, waves: int = 300) -> FloatArray:
    """Draw random fields `(n, outputs)` of unit variance with an RBF spectrum of LENGTH_SCALES."""
    omega = rng.standard_normal((waves, X.shape[1])) / LENGTH_SCALES[: X.shape[1]]
    phase = rng.uniform(0, 2 * np.pi, waves)
    return np.cos(X @ omega.T + phase) @ rng.standard_normal((waves, outputs)) * np.sqrt(2 / waves)


def planted(n: int, seed: int, noise: float = 0.1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inputs `(n, 3)`, noisy outputs `(n, 2)` and the field without noise."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, 3))
    field = smooth_field(X, rng)
    return X, field + noise * rng.standard_normal(field.shape), field


def correlated_noise(groups: int, steps: int, step: float, time: float, rng: np.random.Generator) -> FloatArray:
    """Draw Ornstein-Uhlenbeck noise `(groups * steps,)` of unit variance, independent between groups."""
    keep = np.exp(-step / time)
    noise = rng.standard_normal((groups, steps))
    for i in range(1, steps):
        noise[:, i] = keep * noise[:, i - 1] + np.sqrt(1 - keep**2) * noise[:, i]
    return noise.ravel()


def stretches(groups: int, steps: int, step: float) -> tuple[IntArray, FloatArray]:
    """Return group and time of each sample of `groups` recordings of `steps` samples."""
    return np.repeat(np.arange(groups), steps), np.tile(np.arange(steps) * step, groups)
