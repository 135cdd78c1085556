"""Exact Gaussian-process regression, for sets small enough for the spectrum of their covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.gpr.estimator import GaussianProcess
from gpcorrect.gpr.learning import KernelOption, Learned
from gpcorrect.gpr.predictor import SharedPredictor
from gpcorrect.types import FloatArray, Progress


class ExactGPR(GaussianProcess):
    """Gaussian-process regression from the whole covariance of the data (Rasmussen and Williams 2006, Eq. 2.23).

    Parameters
    ----------
    feature_groups : sequence of sequences of int, optional
        Columns of X that act in part by themselves (pose; velocity): each group adds a component to the kernel.
    output_groups : sequence of int, optional
        How many outputs in turn share a kernel, as (3, 3) for positions and rotations; all of them by default.
    n_learn : int, samples that the hyperparameters are learned from
    n_restarts : int, further searches for the hyperparameters, from random starts
    kernel : "rbf", "matern52" or "auto"
        Correlation function; "auto" takes, for each group of outputs, the one of greater evidence.
    random_state : int, randomState or None, seed of the subset and the restarts

    See Also
    --------
    GaussianProcess : the attributes.
    SparseGPR : for more samples.
    """

    _most_samples = 6000  # the spectrum of more takes minutes and a gigabyte

    def __init__(
        self,
        feature_groups: Sequence[Sequence[int]] | None = None,
        output_groups: Sequence[int] | None = None,
        n_learn: int = 1000,
        n_restarts: int = 0,
        kernel: KernelOption = "rbf",
        random_state: int | None = 0,
    ) -> None:
        self.feature_groups = feature_groups
        self.output_groups = output_groups
        self.n_learn = n_learn
        self.n_restarts = n_restarts
        self.kernel = kernel
        self.random_state = random_state

    def _posterior(
        self, learned: Learned, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress
    ) -> SharedPredictor:
        """With `R = Q diag(lambda) Q^T`, `(R + nu I)^-1 = Q diag(1 / (lambda + nu)) Q^T` for every noise ratio nu."""
        kernel, scaling = learned.kernel, learned.scaling
        eigenvalues, Q = np.linalg.eigh(kernel(X, X))
        spread = np.maximum(eigenvalues, 0.0)[:, None] + learned.noise_ratio
        alpha = Q @ ((Q.T @ scaling.outputs(Y)) / spread)
        progress.step("posterior", 1.0)
        return SharedPredictor(
            kernel=kernel,
            basis=X,
            alpha=(alpha * scaling.y_spread).T,
            offset=scaling.y_centre,
            projection=Q.T,
            explained=(1.0 / spread).T,
            signal=learned.signal,
            noise=learned.noise,
        )
