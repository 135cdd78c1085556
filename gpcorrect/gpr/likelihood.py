"""Marginal likelihood of several outputs that share one correlation function, with analytic gradients.

Output o has covariance `s_o (R + nu_o [(1 - phi_o) I + phi_o E])`: R the correlation over inputs, shared; nu_o the
noise-to-signal ratio; phi_o the share of the noise that is correlated in time, `E_ij = exp(-|t_i - t_j| / T)` inside
one trajectory and zero between two. The signal variance s_o sits at its best for all else, `s_o = y^T C^-1 y / n`, so
by the envelope theorem the gradient is `dL = sum_o tr[(C_o^-1 - a_o a_o^T / s_o) dC_o] / 2` with `a_o = C_o^-1 y_o`
(Rasmussen and Williams 2006, Eq. 5.9).

Without E, whatever pose and velocity do not explain but neighbouring samples share (hysteresis, drift) is taken for a
fine-grained field: length scales and noise come out far too small, and intervals are not honest (docs/design/0002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.linalg import inverse_and_log_determinant
from gpcorrect.gpr.parameters import Layout, NoiseModel
from gpcorrect.types import FloatArray, IntArray

__all__ = ["LearningData", "negative_log_posterior", "profiled_signal", "sample_lags"]

TINY = 1e-12  # a constant output has no signal, and log(0) must not be taken


@dataclass(frozen=True, eq=False)
class LearningData:
    """What the likelihood is taken of.

    Parameters
    ----------
    X : (n, d) array
        Inputs of unit spread.
    Y : (n, m) array
        Centred outputs of unit spread.
    lags : (n, n) array or None
        Seconds between samples of one trajectory, infinite between two; None for white noise.
    """

    X: FloatArray
    Y: FloatArray
    lags: FloatArray | None = None


def sample_lags(groups: IntArray, times: FloatArray | None) -> FloatArray:
    """Lags `(n, n)`, s, infinite between groups; zero inside a group when there are no times."""
    same = groups[:, None] == groups[None, :]
    gaps = np.zeros(same.shape) if times is None else np.abs(times[:, None] - times[None, :])
    return np.where(same, gaps, np.inf)


def negative_log_posterior(theta: FloatArray, data: LearningData, layout: Layout) -> tuple[float, FloatArray]:
    """Negative log marginal likelihood, summed over outputs, plus the prior's penalty; and its gradient.

    Parameters
    ----------
    theta : (p,) array
        As laid out by `layout`.
    data : LearningData
    layout : Layout

    Returns
    -------
    value : float
        Up to a constant.
    gradient : (p,) array
    """
    kernel, noise = layout.kernel(theta), layout.noise(theta)
    parts = kernel.components(data.X, data.X)
    R = sum(w * part for w, part in zip(kernel.weights, parts, strict=True))
    E = None if data.lags is None else np.exp(-data.lags / noise.time)
    value, slope_R, slopes = _outputs(data.Y, np.asarray(R), E, noise)
    gradient = layout.pack(
        *_kernel_gradient(slope_R, parts, data.X, kernel),
        slopes.log_ratio,
        slopes.share * noise.share * (1.0 - noise.share),
        0.0 if data.lags is None else _time_gradient(slopes.E, E, data.lags, noise.time),
    )
    penalty, penalty_gradient = layout.penalty(theta)
    return value + penalty, gradient + penalty_gradient


def profiled_signal(theta: FloatArray, data: LearningData, layout: Layout) -> FloatArray:
    """Best signal variance `(m,)` of each output for given parameters."""
    kernel, noise = layout.kernel(theta), layout.noise(theta)
    R = kernel(data.X, data.X)
    E = None if data.lags is None else np.exp(-data.lags / noise.time)
    quadratic = [y @ np.linalg.solve(_covariance(R, E, noise, o), y) / len(y) for o, y in enumerate(data.Y.T)]
    return np.maximum(quadratic, TINY)


@dataclass(frozen=True, eq=False)
class _NoiseSlopes:
    """Gradients with respect to the noise of each output, and to the matrix E."""

    log_ratio: FloatArray
    share: FloatArray
    E: FloatArray


def _covariance(R: FloatArray, E: FloatArray | None, noise: NoiseModel, output: int) -> FloatArray:
    ratio, share = noise.ratio[output], noise.share[output]
    C = np.array(R) if E is None else R + (ratio * share) * E
    C[np.diag_indices_from(C)] += ratio if E is None else ratio * (1.0 - share)
    return C


def _outputs(
    Y: FloatArray, R: FloatArray, E: FloatArray | None, noise: NoiseModel
) -> tuple[float, FloatArray, _NoiseSlopes]:
    """Sum the likelihood over outputs; slopes with respect to R and E come as full symmetric matrices."""
    n, m = Y.shape
    value, by_ratio, by_share = 0.0, np.zeros(m), np.zeros(m)
    weights, inverses, inverses_E = np.empty((n, m)), np.zeros((n, n)), np.zeros((n, n))
    for o in range(m):
        ratio, share = float(noise.ratio[o]), float(noise.share[o])
        inverse, log_determinant = inverse_and_log_determinant(_covariance(R, E, noise, o))
        a = inverse @ Y[:, o] + inverse.T @ Y[:, o] - np.diagonal(inverse) * Y[:, o]
        signal = max(float(Y[:, o] @ a) / n, TINY)
        value += 0.5 * (n * np.log(signal) + log_determinant)
        weights[:, o] = a / np.sqrt(signal)
        trace = 0.5 * (np.trace(inverse) - weights[:, o] @ weights[:, o])
        inner = trace if E is None else _inner(inverse, weights[:, o], E)
        by_ratio[o] = ratio * ((1.0 - share) * trace + share * inner)
        by_share[o] = ratio * (inner - trace)
        inverses += inverse
        if E is not None:
            inverses_E += (ratio * share) * inverse
    slope_R = _symmetric(inverses) - weights @ weights.T
    slope_E = _symmetric(inverses_E) - (weights * (noise.ratio * noise.share)) @ weights.T
    return value, 0.5 * slope_R, _NoiseSlopes(by_ratio, by_share, 0.5 * slope_E)


def _inner(inverse: FloatArray, weights: FloatArray, E: FloatArray) -> float:
    """`tr[(C^-1 - a a^T / s) E] / 2` from the upper triangle of C^-1; the diagonal of E is one."""
    return float(np.vdot(inverse, E) - 0.5 * np.trace(inverse) - 0.5 * (weights @ (E @ weights)))


def _symmetric(triangle: FloatArray) -> FloatArray:
    full: FloatArray = triangle + triangle.T
    full[np.diag_indices_from(full)] *= 0.5
    return full


def _kernel_gradient(
    slope: FloatArray, parts: list[FloatArray], X: FloatArray, kernel: AdditiveRBF
) -> tuple[FloatArray, FloatArray]:
    """Gradients with respect to the log length scales `(c, d)` and the log odds of the weights `(c,)`."""
    by_scale, by_weight = np.empty(kernel.length_scales.shape), np.empty(len(parts))
    for c, part in enumerate(parts):
        by_weight[c] = np.vdot(slope, part)
        H = kernel.weights[c] * slope * part
        A = X / kernel.length_scales[c]
        # sum_ij H_ij (A_i - A_j)^2 for each feature, without the n x n x d differences
        by_scale[c] = 2.0 * (H.sum(axis=1) @ (A * A) - np.einsum("nd,nd->d", A, H @ A))
    by_odds = kernel.weights * (by_weight - kernel.weights @ by_weight)
    return by_scale, by_odds


def _time_gradient(slope: FloatArray, E: FloatArray | None, lags: FloatArray, time: float) -> float:
    """Gradient with respect to the log of the correlation time."""
    assert E is not None
    finite = np.where(np.isfinite(lags), lags, 0.0)
    return float(np.vdot(slope, E * finite) / time)
