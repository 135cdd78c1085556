"""Kernels: the correlation between inputs as an object, with its gradient and the table that the hot path reads.

`k(x, z) = sum_c w_c f(s_c(x, z))`, `s_c = sum_d ((x_d - z_d) / l_cd)^2`, weights summing to one and `f(0) = 1`. A
component that does not see a feature has an infinite length scale there. With groups (pose), (velocity) the sum says:
part of the error depends on pose alone, part on velocity alone, the rest on both together (additive Gaussian
processes: Duvenaud et al. 2011). One component is the usual kernel with automatic relevance determination.

A new kernel is a class here that states f and its slope, a line in `KERNELS`, and a branch of `predictor.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, frozen_array

ROWS = 256  # of a matrix at once: what is worked on stays in the processor's cache; changes the speed only

Pullback = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class KernelTable(NamedTuple):
    """What the hot path reads of a kernel: squared distances to p basis points, linear in the input but for one number.

    `-s_c / 2 = level + slope . u - inverse . u^2` for an input u (d,) counted from `origin`.
    """

    code: FloatArray  # (1,) which f
    origin: FloatArray  # (d,)
    inverse: FloatArray  # (c, d): 1 / length_scale^2 / 2, zero where a component does not see a feature
    slopes: FloatArray  # (c, d, p)
    levels: FloatArray  # (c, p)
    log_weights: FloatArray  # (c,)


@dataclass(frozen=True, eq=False)
class Kernel(ABC):
    """Correlation function of unit variance.

    Parameters
    ----------
    weights : (c,) array, positive, summing to one
    length_scales : (c, d) array, positive; infinite where a component does not see a feature
    """

    weights: FloatArray
    length_scales: FloatArray

    name: ClassVar[str]  # in settings and model files
    code: ClassVar[float]  # in predictor.py

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", frozen_array(self.weights))
        object.__setattr__(self, "length_scales", frozen_array(self.length_scales))

    @staticmethod
    @abstractmethod
    def profile_and_slope(halves: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f and `-2 df/ds` of `-s / 2` `(n, m)`, which it may use up."""

    def __call__(self, A: FloatArray, B: FloatArray) -> FloatArray:
        """Return the correlation matrix `(n, m)` of inputs `(n, d)` and `(m, d)`."""
        total = np.zeros((len(A), len(B)))
        for start in range(0, len(A), ROWS):
            rows = slice(start, start + ROWS)
            for weight, scales in zip(self.weights, self.length_scales, strict=True):
                part, _ = self.profile_and_slope(_half_squares(A[rows] / scales, B / scales))
                part *= weight
                total[rows] += part
        return total

    def diagonal(self, A: FloatArray) -> FloatArray:
        """Return the correlations `(n,)` of inputs `(n, d)` with themselves.

        Parameters
        ----------
        A : (n, d) array, inputs
        """
        return np.ones(len(A))

    def with_gradient(self, X: FloatArray) -> tuple[FloatArray, Pullback]:
        """Return the correlation matrix R `(n, n)` of inputs `(n, d)`, and the chain rule through it.

        The latter takes a matrix U `(n, n)`, of which it may be that only a triangle is not zero, and returns the
        gradients of `sum_ij U_ij R_ij` with respect to the log length scales `(c, d)` and the log odds of the weights
        `(c,)`.

        Parameters
        ----------
        X : (n, d) array, inputs
        """
        parts = [self.profile_and_slope(_half_squares(X / scales, X / scales)) for scales in self.length_scales]
        R = self.weights[0] * parts[0][0]
        for weight, (part, _) in zip(self.weights[1:], parts[1:], strict=True):
            R += weight * part

        def pullback(upstream: FloatArray) -> tuple[FloatArray, FloatArray]:
            by_scale, by_weight = np.empty(self.length_scales.shape), np.empty(len(parts))
            for c, (part, slope) in enumerate(parts):
                by_weight[c] = np.vdot(upstream, part)
                H = upstream * slope
                A = X / self.length_scales[c]
                # sum_ij H_ij (A_i - A_j)^2 for each feature, without the n x n x d differences
                squares = (H.sum(axis=0) + H.sum(axis=1)) @ (A * A)
                by_scale[c] = self.weights[c] * (squares - 2.0 * np.einsum("nd,nd->d", A, H @ A))
            return by_scale, self.weights * (by_weight - self.weights @ by_weight)

        return R, pullback

    def table(self, basis: FloatArray) -> KernelTable:
        """Return what the hot path reads for basis points `(p, d)`.

        Parameters
        ----------
        basis : (p, d) array, points that predictions rest on
        """
        inverse = self.length_scales**-2.0
        origin = basis.mean(axis=0)
        shifted = basis - origin
        return KernelTable(
            code=np.array([self.code]),
            origin=origin,
            inverse=0.5 * inverse,
            slopes=inverse[:, :, None] * shifted.T[None],
            levels=-0.5 * inverse @ (shifted**2).T,
            log_weights=np.log(self.weights),
        )


class AdditiveRBF(Kernel):
    """Squared exponential, `f(s) = exp(-s / 2)`: fields that are smooth to any order."""

    name = "rbf"
    code = 0.0

    @staticmethod
    def profile_and_slope(halves: FloatArray) -> tuple[FloatArray, FloatArray]:  # noqa: D102  # documented on the base
        part = np.exp(halves, out=halves)
        return part, part


class AdditiveMatern52(Kernel):
    """Matern 5/2, `f(s) = (1 + r + r^2 / 3) exp(-r)`, `r = sqrt(5 s)`: fields that bend twice and no oftener.

    Rasmussen and Williams 2006, Eq. 4.17.
    """

    name = "matern52"
    code = 1.0

    @staticmethod
    def profile_and_slope(halves: FloatArray) -> tuple[FloatArray, FloatArray]:  # noqa: D102  # documented on the base
        r = np.sqrt(-10.0 * halves)
        decay = np.exp(-r)
        return (1.0 + r + r * r / 3.0) * decay, 5.0 / 3.0 * (1.0 + r) * decay


@dataclass(frozen=True, eq=False)
class WithLinear:
    """A kernel with a straight line beside it: `k(x, z) + 1 + sum_d w_d x_d z_d`.

    The line runs on past the data, and so does its uncertainty, where a kernel alone falls back to zero and one.

    Parameters
    ----------
    kernel : AdditiveRBF, what bends
    slopes : (d,) array, prior variance of the line's slope along each feature
    """

    kernel: AdditiveRBF
    slopes: FloatArray

    def __call__(self, A: FloatArray, B: FloatArray) -> FloatArray:
        """Return the covariance matrix `(n, m)` of inputs `(n, d)` and `(m, d)`."""
        return 1.0 + (A * self.slopes) @ B.T + self.kernel(A, B)

    def diagonal(self, A: FloatArray) -> FloatArray:
        """Return the variances `(n,)` of inputs `(n, d)`.

        Parameters
        ----------
        A : (n, d) array, inputs
        """
        return 1.0 + A**2 @ self.slopes + self.kernel.diagonal(A)


KERNELS: dict[str, type[Kernel]] = {kernel.name: kernel for kernel in (AdditiveRBF, AdditiveMatern52)}


def component_masks(n_features: int, groups: Sequence[Sequence[int]] | None) -> BoolArray:
    """Return the mask `(c, d)` of the features each component sees: every group first, all features last.

    A group that is empty or holds every feature adds nothing and is left out.

    Parameters
    ----------
    n_features : int, d
    groups : sequence of sequences of int, optional, columns of each group
    """
    masks = []
    for group in groups or ():
        columns = np.asarray(group, dtype=np.int64)
        if columns.size and (columns.min() < 0 or columns.max() >= n_features):
            raise DataError(f"feature group {tuple(group)} names columns outside the {n_features} features.")
        mask = np.zeros(n_features, dtype=bool)
        mask[columns] = True
        if mask.any() and not mask.all():
            masks.append(mask)
    return np.array([*masks, np.ones(n_features, dtype=bool)])


def _half_squares(A: FloatArray, B: FloatArray) -> FloatArray:
    """Minus half the squared Euclidean distances `(n, m)` between rows, never above zero."""
    # The norms are part of the product, for a pass over the result costs as much as it.
    left = np.hstack([A, -0.5 * np.einsum("nd,nd->n", A, A)[:, None], np.ones((len(A), 1))])
    right = np.hstack([B, np.ones((len(B), 1)), -0.5 * np.einsum("md,md->m", B, B)[:, None]])
    halves: FloatArray = left @ right.T
    return np.minimum(halves, 0.0, out=halves)
