"""Hyperparameters by maximum a posteriori on a subset: which samples, where to start, what comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.likelihood import LearningData, negative_log_posterior, profiled_signal, sample_lags
from gpcorrect.gpr.parameters import Layout
from gpcorrect.types import BoolArray, FloatArray, IntArray, Progress, frozen_array

__all__ = ["Hyperparameters", "learn"]

MOST_STEPS = 80
TOLERANCE = (
    1e-5  # relative change of the objective: further steps move predictions by less than the choice of subset does
)
RESTART_SPREAD = 0.7  # log units around the first start


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """What the marginal likelihood decides, in units of inputs and outputs of unit spread.

    Parameters
    ----------
    kernel : AdditiveRBF
        Correlation over inputs, shared by the outputs.
    signal, noise : (m,) arrays
        Variances.
    correlated_share : (m,) array
        Share of the noise that neighbouring samples have in common.
    correlation_time : float
        How long they have it in common, s.
    objective : float
        Negative log posterior up to a constant, of the best search.
    evaluations : int
        Evaluations spent.
    theta : (p,) array
        The same as the search saw it, :class:`gpcorrect.gpr.parameters.Layout`: where another search may start.
    """

    kernel: AdditiveRBF
    signal: FloatArray
    noise: FloatArray
    correlated_share: FloatArray
    correlation_time: float
    objective: float
    evaluations: int
    theta: FloatArray

    def __post_init__(self) -> None:
        for name in ("signal", "noise", "correlated_share", "theta"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))


def learn(
    X: FloatArray,
    Y: FloatArray,
    masks: BoolArray,
    groups: IntArray | None,
    times: FloatArray | None,
    *,
    restarts: int,
    rng: np.random.Generator,
    progress: Progress,
    start: FloatArray | None = None,
) -> Hyperparameters:
    """Return the best of `1 + restarts` searches by L-BFGS-B.

    Parameters
    ----------
    X, Y : (n, d) and (n, m) arrays
        Of unit spread, outputs centred.
    masks : (c, d) bool array
        Features that each component of the kernel sees.
    groups, times : (n,) arrays or None
        Trajectory and time (s) of each sample; None takes the noise as white.
    restarts : int
        Further searches from random starts.
    rng : numpy.random.Generator
        Source of the random starts.
    progress : Progress
        Told after each search.
    start : (p,) array, optional
        Where the first search starts, as it came out of a search of data of the same kind.
    """
    data = LearningData(X, Y, None if groups is None else sample_lags(groups, times))
    correlated = data.lags is not None
    layout = Layout(masks, Y.shape[1], correlated, _time_range(data.lags) if correlated and times is not None else None)
    best_value, best_theta, evaluations = np.inf, layout.start, 0
    for attempt in range(1 + restarts):
        result = minimize(
            negative_log_posterior,
            _start(layout, start, attempt, rng),
            args=(data, layout),
            jac=True,
            method="L-BFGS-B",
            bounds=layout.bounds,
            options={"maxiter": MOST_STEPS, "ftol": TOLERANCE},
        )
        evaluations += int(result.nfev)
        if result.fun < best_value:
            best_value, best_theta = float(result.fun), result.x
        progress.step("hyperparameters", (attempt + 1) / (1 + restarts))
    return _hyperparameters(best_theta, data, layout, best_value, evaluations)


def _hyperparameters(
    theta: FloatArray, data: LearningData, layout: Layout, value: float, evaluations: int
) -> Hyperparameters:
    noise, signal = layout.noise(theta), profiled_signal(theta, data, layout)
    return Hyperparameters(
        kernel=layout.kernel(theta),
        signal=signal,
        noise=signal * noise.ratio,
        correlated_share=noise.share,
        correlation_time=noise.time,
        objective=value,
        evaluations=evaluations,
        theta=theta,
    )


def _start(layout: Layout, known: FloatArray | None, attempt: int, rng: np.random.Generator) -> FloatArray:
    low, high = np.array(layout.bounds).T
    if attempt == 0:
        return layout.start if known is None else np.clip(known, low, high)
    return np.clip(layout.start + RESTART_SPREAD * rng.standard_normal(len(layout.start)), low, high)


def _time_range(lags: FloatArray | None) -> tuple[float, float]:
    """Correlation times that these samples can tell: from their shortest step to their longest stretch."""
    assert lags is not None
    known = lags[np.isfinite(lags) & (lags > 0)]
    if known.size == 0:
        return 1.0, 1.0
    return float(known.min()), float(10.0 * known.max())
