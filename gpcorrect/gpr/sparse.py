"""Sparse Gaussian-process regression: all data through a few inducing points, in blocks, at a cost linear in their number.

The variational posterior of Titsias (2009). With `L L^T = K_zz`, `V = L^-1 K_zx` and `V V^T = U diag(lambda) U^T` the bound of every
output needs only `lambda`, `q = U^T V y` and `y^T y`; one eigenproblem serves all outputs and every noise variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cholesky, solve_triangular
from sklearn.cluster import MiniBatchKMeans

from gpcorrect.gpr.base import GaussianProcess
from gpcorrect.gpr.kernels import rbf
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.variances import Objective, best_ratios
from gpcorrect.types import FloatArray

__all__ = ["SparseGPR"]

BLOCK = 2048
JITTER = 1e-6  # relative to the unit diagonal; below the noise of any sensor, above rounding
CLUSTER_SAMPLES = 20_000  # inducing points are placed by this many rows at most
NEGLIGIBLE = 1e-4  # directions that lessen the prior variance by less are left out of the predictor


class SparseGPR(GaussianProcess):
    """Variational inducing-point regression (Titsias 2009): length scales from a subset, then all data.

    Parameters
    ----------
    n_inducing : int
        Inducing points, placed by k-means in the scaled inputs.
    n_subset : int
        Rows that the length scales are learned on.
    n_restarts : int
        Further searches for the length scales, from random starts.
    random_state : int, RandomState or None
        Seed of the subset, the restarts and the inducing points.

    Attributes
    ----------
    length_scale_ : (d,) array
        Of each feature, in its own unit.
    predictor_ : Predictor
        The posterior.
    """

    def __init__(
        self, n_inducing: int = 500, n_subset: int = 600, n_restarts: int = 0, random_state: int | None = 0
    ) -> None:
        self.n_inducing = n_inducing
        self.n_subset = n_subset
        self.n_restarts = n_restarts
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from inputs `(n, d)` and outputs `(n,)` or `(n, m)`."""
        return self._fit(X, y, self.n_subset)

    def _posterior(self, A: FloatArray, B: FloatArray, length_scale: FloatArray, rng: np.random.Generator) -> Predictor:
        inputs = A / length_scale
        basis = _inducing_points(inputs, self.n_inducing, rng)
        L = cholesky(rbf(basis, basis) + JITTER * np.eye(len(basis)), lower=True)
        seen = _project(inputs, B, basis, L)
        ratios = best_ratios(seen.objective, B.shape[1])
        signal = seen.signal(ratios[None])[0]
        return self._predictor(length_scale, basis, L, seen, ratios, signal)

    def _predictor(
        self,
        length_scale: FloatArray,
        basis: FloatArray,
        L: FloatArray,
        seen: _Projection,
        ratios: FloatArray,
        signal: FloatArray,
    ) -> Predictor:
        y_spread = self.scaling_.y_spread
        shrink = seen.eigenvalues / (seen.eigenvalues + ratios[:, None])
        kept = shrink.max(axis=0) > NEGLIGIBLE
        factor = solve_triangular(L, seen.U, lower=True, trans="T").T
        weights = factor.T @ (seen.q / (seen.eigenvalues[:, None] + ratios))
        return Predictor(
            scale=1.0 / (length_scale * self.scaling_.x_spread),
            basis=basis,
            half_squares=0.5 * (basis**2).sum(axis=1),
            alpha=(weights * y_spread).T,
            centre=self.scaling_.y_centre,
            factor=factor[kept],
            shrink=shrink[:, kept],
            signal=signal * y_spread**2,
            noise=signal * ratios * y_spread**2,
        )


@dataclass(frozen=True, eq=False)
class _Projection:
    """All data as the inducing points see them."""

    eigenvalues: FloatArray
    U: FloatArray
    q: FloatArray
    squares: FloatArray
    n: int

    def signal(self, ratios: FloatArray) -> FloatArray:
        """Best signal variances `(k, m)` for noise-to-signal ratios `(k, m)`."""
        explained = (self.q[:, None, :] ** 2 / (self.eigenvalues[:, None, None] + ratios)).sum(axis=0)
        return np.maximum((self.squares - explained) / (self.n * ratios), 1e-300)

    @property
    def objective(self) -> Objective:
        """Negative bound on the log marginal likelihood, up to a constant (Titsias 2009, Eq. 9)."""
        rank, unseen = len(self.eigenvalues), max(self.n - float(self.eigenvalues.sum()), 0.0)

        def objective(ratios: FloatArray) -> FloatArray:
            spread = np.log(self.eigenvalues[:, None, None] + ratios).sum(axis=0) + (self.n - rank) * np.log(ratios)
            bound: FloatArray = 0.5 * (self.n * np.log(self.signal(ratios)) + spread + unseen / ratios)
            return bound

        return objective


def _inducing_points(inputs: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Centres of k-means clusters; the samples themselves where there are no more of them."""
    distinct = np.unique(inputs[rng.permutation(len(inputs))[:CLUSTER_SAMPLES]], axis=0)
    if len(distinct) <= count:
        return distinct
    clusters = MiniBatchKMeans(count, n_init=1, batch_size=4096, max_iter=20, random_state=int(rng.integers(2**31 - 1)))
    centres: FloatArray = clusters.fit(distinct).cluster_centers_
    return np.asarray(centres, dtype=np.float64)


def _project(inputs: FloatArray, outputs: FloatArray, basis: FloatArray, L: FloatArray) -> _Projection:
    M = len(basis)
    C, P = np.zeros((M, M)), np.zeros((M, outputs.shape[1]))
    for i in range(0, len(inputs), BLOCK):
        V = solve_triangular(L, rbf(basis, inputs[i : i + BLOCK]), lower=True, check_finite=False, overwrite_b=True)
        C += V @ V.T
        P += V @ outputs[i : i + BLOCK]
    eigenvalues, U = np.linalg.eigh(C)
    return _Projection(np.maximum(eigenvalues, 0.0), U, U.T @ P, (outputs**2).sum(axis=0), len(inputs))
