"""scikit-learn: exact regression, ARD kernel, L-BFGS-B on the marginal likelihood."""

from __future__ import annotations

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from gpcorrect.types import FloatArray
from peers.peer import Peer, subset


class Exact:
    """A regressor for each output, or one whose kernel all outputs share."""

    def __init__(self, X: FloatArray, Y: FloatArray, *, shared: bool) -> None:
        kernel = ConstantKernel(1.0) * RBF(np.full(X.shape[1], 3.0), (1e-2, 1e3)) + WhiteKernel(0.1, (1e-6, 1e1))
        columns = [Y] if shared else [Y[:, [o]] for o in range(Y.shape[1])]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            self.models = [
                GaussianProcessRegressor(kernel, normalize_y=True, random_state=0).fit(X, column) for column in columns
            ]

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations."""
        means, stds = zip(*(model.predict(X, return_std=True) for model in self.models), strict=True)
        return np.column_stack(means), np.column_stack(stds)


def exact(X: FloatArray, Y: FloatArray, limit: float, *, size: int, shared: bool) -> tuple[Peer, str]:
    """Fit to a random subset; the limit is not needed."""
    rows = subset(X, size)
    return Exact(X[rows], Y[rows], shared=shared), ""
