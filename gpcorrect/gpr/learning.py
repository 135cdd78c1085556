"""Hyperparameters by maximum a posteriori: where the search starts, which kernel it takes, what comes out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from scipy.optimize import minimize

from gpcorrect.errors import DataError
from gpcorrect.gpr.kernels import KERNELS, Kernel
from gpcorrect.gpr.likelihood import Layout, LearningData, negative_log_posterior, profiled_signal, sample_lags
from gpcorrect.types import BoolArray, FloatArray, IntArray, Progress, frozen_array

KernelOption = Literal["rbf", "matern52", "auto"]

MOST_STEPS = 80  # of L-BFGS-B: searches end by the tolerance before
# Relative change of the objective. Ten times as much takes 0.7 of the evaluations, and errors at held-out data of a
# dVRK and of simulated reaches change by less than 1 %; but of 240 samples it left one search a tenfold error away.
TOLERANCE = 1e-5
# The same of a search that starts where one of data of the same kind ended: half the evaluations and the same errors;
# from eight trajectories 96.0, 98.5 and 91.5 % covered become 96.6, 96.5 and 91.5 % (docs/design/0002).
TOLERANCE_FROM_KNOWN = 1e-4
FLAT = 1e-12  # a column whose spread is this small beside its values is constant but for rounding


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """What the marginal likelihood decides, in units of inputs and outputs of unit spread."""

    kernel: Kernel  # correlation over inputs, shared by the outputs
    # (m,) each: variances
    signal: FloatArray
    noise: FloatArray
    correlated_share: FloatArray  # (m,) share of the noise that neighbouring samples have in common
    correlation_time: float  # how long they have it in common, s
    objective: float  # negative log posterior up to a constant, of the best search
    # (p,) the same as the search saw it, :class:`gpcorrect.gpr.likelihood.Layout`: where another search may start
    theta: FloatArray

    def __post_init__(self) -> None:
        for name in ("signal", "noise", "correlated_share", "theta"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Scaling:
    """Spread of inputs and centre and spread of outputs; a column that does not vary keeps its unit."""

    x_spread: FloatArray
    y_centre: FloatArray
    y_spread: FloatArray

    @classmethod
    def of(cls, X: FloatArray, Y: FloatArray) -> Self:
        """Scaling that gives the columns of `X` (n, d) and `Y` (n, m) unit spread.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and outputs
        """
        return cls(_spread(X), Y.mean(axis=0), _spread(Y))

    def outputs(self, Y: FloatArray) -> FloatArray:
        """Return outputs `(n, m)` centred and of unit spread.

        Parameters
        ----------
        Y : (n, m) array, outputs
        """
        return (Y - self.y_centre) / self.y_spread


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned of one group of outputs before the posterior: their kernel, variances and units."""

    columns: slice  # the group's outputs
    scaling: Scaling  # units in which the hyperparameters are
    hyperparameters: Hyperparameters

    @property
    def kernel(self) -> Kernel:
        """Correlation over inputs in the inputs' own units."""
        kernel = self.hyperparameters.kernel
        return type(kernel)(kernel.weights, kernel.length_scales * self.scaling.x_spread)

    @property
    def signal(self) -> FloatArray:
        """Prior variance `(m,)` in squared units of the outputs."""
        return self.hyperparameters.signal * self.scaling.y_spread**2

    @property
    def noise(self) -> FloatArray:
        """Noise variance `(m,)` in squared units of the outputs."""
        return self.hyperparameters.noise * self.scaling.y_spread**2


def learn(
    X: FloatArray,
    Y: FloatArray,
    masks: BoolArray,
    groups: IntArray | None,
    times: FloatArray | None,
    *,
    progress: Progress,
    start: FloatArray | None = None,
    kernel: KernelOption = "rbf",
) -> Hyperparameters:
    """Return what a search by L-BFGS-B finds, the best of the kernels that may be taken.

    A further kernel is searched from where the first one's search ended; that of the greater posterior is taken.

    Parameters
    ----------
    X, Y : (n, d) and (n, m) arrays, of unit spread, outputs centred
    masks : (c, d) bool array, features that each component of the kernel sees
    groups, times : (n,) arrays or None, trajectory and time (s) of each sample; None takes the noise as white
    progress : Progress, updated after the search
    start : (p,) array, optional, where the first search starts, as it came out of a search of data of the same kind
    kernel : "rbf", "matern52" or "auto", Kernel, or "auto" for any
    """
    if kernel not in ("auto", *KERNELS):
        raise DataError(f"a kernel is one of {', '.join(KERNELS)}, got {kernel!r}.")
    kinds = list(KERNELS.values()) if kernel == "auto" else [KERNELS[kernel]]
    data = LearningData(X, Y, sample_lags(groups, times))
    time_range = None if groups is None or times is None else _time_range(data.lags.seconds)
    layout = Layout(masks, Y.shape[1], groups is not None, time_range, kinds[0])
    if start is not None and len(start) != len(layout.start):
        raise DataError(
            f"a search that goes on from {len(start)} hyperparameters cannot go on with {len(layout.start)}:"
            " data of the same kind have as many.",
            hint="Give groups and times where the first fit had them, and only there.",
        )
    first, tolerance = layout.start, TOLERANCE
    if start is not None:
        first, tolerance = np.clip(start, *np.array(layout.bounds).T), TOLERANCE_FROM_KNOWN
    best = _search(data, layout, first, tolerance)
    for kind in kinds[1:]:
        other = _search(data, replace(layout, kind=kind), best.theta, TOLERANCE)
        best = min(best, other, key=lambda h: h.objective)
    progress.step("hyperparameters", 1.0)
    return best


def _search(data: LearningData, layout: Layout, start: FloatArray, tolerance: float) -> Hyperparameters:
    best = minimize(
        negative_log_posterior,
        start,
        args=(data, layout),
        jac=True,
        method="L-BFGS-B",
        bounds=layout.bounds,
        options={"maxiter": MOST_STEPS, "ftol": tolerance},
    )
    noise, signal = layout.noise(best.x), profiled_signal(best.x, data, layout)
    return Hyperparameters(
        kernel=layout.kernel(best.x),
        signal=signal,
        noise=signal * noise.ratio,
        correlated_share=noise.share,
        correlation_time=noise.time,
        objective=float(best.fun),
        theta=best.x,
    )


def _time_range(lags: FloatArray) -> tuple[float, float]:
    """Correlation times that these samples can tell: from their shortest step to their longest stretch."""
    known = lags[lags > 0]
    if known.size == 0:
        return 1.0, 1.0
    return float(known.min()), float(10.0 * known.max())


def _spread(values: FloatArray) -> FloatArray:
    spread = values.std(axis=0)
    return np.where(spread <= FLAT * np.abs(values).max(axis=0), 1.0, spread)
