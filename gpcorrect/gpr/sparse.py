"""Sparse Gaussian-process regression: all data through inducing points, in blocks, at a cost linear in their number.

The variational posterior of Titsias (2009). With `L L^T = K_zz` and `V = L^-1 K_zx` the posterior needs only `G = V
V^T` and `V y`, sums over samples; one spectrum of G serves all outputs and every noise variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, cho_factor, cho_solve, solve_triangular

from gpcorrect.gpr.estimator import GaussianProcess
from gpcorrect.gpr.inducing import choose_inducing
from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.learned import Learned
from gpcorrect.gpr.linalg import cholesky
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.shared_predictor import SharedPredictor
from gpcorrect.types import FloatArray, Progress

__all__ = ["SparseGPR"]

BLOCK = 2048
NEGLIGIBLE = 1e-6  # directions along which the data take away less of the prior variance are left out of the predictor


class SparseGPR(GaussianProcess):
    """Variational inducing-point regression (Titsias 2009): hyperparameters from a subset, then all data.

    Parameters
    ----------
    n_inducing : int
        Inducing points that the mean rests on.
    n_variance : int
        How many of them the variance rests on: the part of a query that costs their square.
    feature_groups : sequence of sequences of int, optional
        Columns of X that act in part by themselves (pose; velocity): each group adds a component to the kernel.
    output_groups : sequence of int, optional
        How many outputs in turn share a kernel, as (3, 3) for positions and rotations; all of them by default.
    n_learn : int
        Samples that the hyperparameters are learned from.
    n_restarts : int
        Further searches for the hyperparameters, from random starts.
    random_state : int, RandomState or None
        Seed of the subset, the restarts and the inducing points.

    Attributes
    ----------
    jitter_ : float
        What had to be added to the inducing points' correlations (of unit variance) for their factorisation;
        the largest of the groups of outputs.
    unseen_ : float
        Mean share of prior variance that the inducing points cannot see at the training samples; likewise.

    See Also
    --------
    GaussianProcess : the other attributes.
    """

    def __init__(
        self,
        n_inducing: int = 700,
        n_variance: int = 250,
        feature_groups: Sequence[Sequence[int]] | None = None,
        output_groups: Sequence[int] | None = None,
        n_learn: int = 500,
        n_restarts: int = 0,
        random_state: int | None = 0,
    ) -> None:
        self.n_inducing = n_inducing
        self.n_variance = n_variance
        self.feature_groups = feature_groups
        self.output_groups = output_groups
        self.n_learn = n_learn
        self.n_restarts = n_restarts
        self.random_state = random_state

    def _predictor(self, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress) -> Predictor:
        self.jitter_, self.unseen_ = 0.0, 0.0
        return super()._predictor(X, Y, rng, progress)

    def _posterior(
        self, learned: Learned, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress
    ) -> SharedPredictor:
        kernel = learned.kernel
        basis = self._inducing_points(kernel, X, rng)
        seen = _project(learned, basis, X, Y, progress)
        self.jitter_ = max(self.jitter_, seen.jitter)
        self.unseen_ = max(self.unseen_, seen.unseen(len(basis)))
        projection, explained = seen.variance_factors(learned.noise_ratio, min(self.n_variance, len(basis)))
        return SharedPredictor(
            component_weights=kernel.weights,
            length_scales=kernel.length_scales,
            basis=basis,
            alpha=(seen.mean_weights(learned.noise_ratio) * learned.scaling.y_spread).T,
            offset=learned.scaling.y_centre,
            projection=projection,
            explained=explained,
            signal=learned.signal,
            noise=learned.noise,
        )

    def _inducing_points(self, kernel: AdditiveRBF, X: FloatArray, rng: np.random.Generator) -> FloatArray:
        return choose_inducing(kernel, X, self.n_inducing, rng)


@dataclass(frozen=True, eq=False)
class _Projection:
    """All n samples as the inducing points see them: factor L, Gram matrix G and `V y` as in the head of this module.

    What the points cannot see of the field acts on the data like noise, so it is counted with the noise: without
    that, too few points for a rough field make an overconfident fit (docs/design/0002 has the figures).
    """

    L: FloatArray
    G: FloatArray
    Vy: FloatArray
    n: int
    jitter: float

    def unseen(self, count: int) -> float:
        """Mean share of prior variance that the first `count` points leave at the samples."""
        return max(1.0 - float(np.trace(self.G[:count, :count])) / self.n, 0.0)

    def mean_weights(self, ratio: FloatArray) -> FloatArray:
        """Weights `(M, m)` of the correlations to all points in the mean."""
        diagonal = np.diag_indices_from(self.G)
        solved = np.empty(self.Vy.shape)
        for o, noise in enumerate(ratio + self.unseen(len(self.G))):
            system = np.array(self.G, order="F")
            system[diagonal] += noise
            solved[:, o] = cho_solve(
                cho_factor(system, lower=True, overwrite_a=True, check_finite=False), self.Vy[:, o]
            )
        weights: FloatArray = solve_triangular(self.L, solved, lower=True, trans="T", check_finite=False)
        return weights

    def variance_factors(self, ratio: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Projection `(r, count)` and explained shares `(m, r)` of the variance that the first `count` points give."""
        eigenvalues, U = np.linalg.eigh(self.G[:count, :count])
        eigenvalues = np.maximum(eigenvalues, 0.0)
        explained = eigenvalues / (eigenvalues + (ratio + self.unseen(count))[:, None])
        kept = explained.max(axis=0) > NEGLIGIBLE
        kept[-1] = True  # an output of pure noise still needs a direction to say so
        projection = solve_triangular(self.L[:count, :count], U[:, kept], lower=True, trans="T", check_finite=False).T
        return projection, explained[:, kept]


def _project(learned: Learned, basis: FloatArray, X: FloatArray, Y: FloatArray, progress: Progress) -> _Projection:
    """Sum over the samples in blocks: memory does not grow with their number."""
    kernel = learned.kernel
    L, jitter = cholesky(kernel(basis, basis))
    G, Vy = np.zeros((len(basis), len(basis)), order="F"), np.zeros((len(basis), Y.shape[1]))
    for start in range(0, len(X), BLOCK):
        rows = slice(start, start + BLOCK)
        V = solve_triangular(L, kernel(X[rows], basis).T, lower=True, overwrite_b=True, check_finite=False)
        G = blas.dsyrk(1.0, V, beta=1.0, c=G, lower=1, overwrite_c=1)
        Vy += V @ learned.scaling.outputs(Y[rows])
        progress.step("posterior", min(1.0, (start + BLOCK) / len(X)))
    return _Projection(L, np.tril(G) + np.tril(G, -1).T, Vy, len(X), jitter)
