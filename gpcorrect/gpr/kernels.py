"""The correlation between inputs: a sum of squared exponentials, one over all features and one over each group of them.

`k(x, z) = sum_c w_c exp(-|x - z|_c^2 / 2)`, `|x - z|_c^2 = sum_d ((x_d - z_d) / l_cd)^2`, weights summing to one. A
component that does not see a feature has an infinite length scale there. With groups (pose), (velocity) the sum says:
part of the error depends on pose alone, part on velocity alone, the rest on both together (additive Gaussian
processes: Duvenaud et al. 2011). One component is the usual ARD kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, frozen_array

__all__ = ["AdditiveRBF", "component_masks", "squared_distances"]


@dataclass(frozen=True, eq=False)
class AdditiveRBF:
    """Correlation function of unit variance.

    Parameters
    ----------
    weights : (c,) array
        Positive, summing to one.
    length_scales : (c, d) array
        Positive; infinite where a component does not see a feature.
    """

    weights: FloatArray
    length_scales: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", frozen_array(self.weights))
        object.__setattr__(self, "length_scales", frozen_array(self.length_scales))

    def components(self, A: FloatArray, B: FloatArray) -> list[FloatArray]:
        """Correlation matrices `(n, m)` of each component, not yet weighted, for inputs `(n, d)` and `(m, d)`."""
        return [_rbf(A / scales, B / scales) for scales in self.length_scales]

    def __call__(self, A: FloatArray, B: FloatArray) -> FloatArray:
        """Correlation matrix `(n, m)` of inputs `(n, d)` and `(m, d)`."""
        total = np.zeros((len(A), len(B)))
        for weight, part in zip(self.weights, self.components(A, B), strict=True):
            part *= weight
            total += part
        return total


def component_masks(n_features: int, groups: Sequence[Sequence[int]] | None) -> BoolArray:
    """Mask `(c, d)` of the features each component sees: every group first, all features last.

    A group that is empty or holds every feature adds nothing and is left out.

    Raises
    ------
    DataError
        A group names a feature that does not exist.
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


def squared_distances(A: FloatArray, B: FloatArray) -> FloatArray:
    """Squared Euclidean distances `(n, m)` between the rows of `A` (n, d) and `B` (m, d), never below zero."""
    squares: FloatArray = A @ (-2.0 * B.T)
    squares += np.einsum("nd,nd->n", A, A)[:, None]
    squares += np.einsum("md,md->m", B, B)
    return np.maximum(squares, 0.0, out=squares)


def _rbf(A: FloatArray, B: FloatArray) -> FloatArray:
    """Squared exponential `(n, m)` of inputs already divided by their length scales."""
    correlation = squared_distances(A, B)
    correlation *= -0.5
    np.exp(correlation, out=correlation)
    return correlation
