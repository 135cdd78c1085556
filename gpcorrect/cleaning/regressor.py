"""Linear regression by least median of squares, as a scikit-learn estimator."""

from __future__ import annotations

from numbers import Integral
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from gpcorrect.cleaning.lmeds import least_median
from gpcorrect.types import FloatArray, IntArray

__all__ = ["LeastMedianOfSquares"]


class LeastMedianOfSquares(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Hyperplane that half of the data agrees on, whatever the other half says (Rousseeuw 1984).

    Cleaning uses it for the trend of the error over the workspace, from which the smooth model starts.

    Parameters
    ----------
    sample_size : int or None
        Rows in a random sample; None takes as many as there are coefficients, the fewest that determine them.
    random_state : int, RandomState or None
        Source of the samples.

    Attributes
    ----------
    coef_ : (d,) or (outputs, d) array
        Slopes.
    intercept_ : float or (outputs,) array
        Values at the origin.
    scale_ : float
        Robust standard deviation of one output about the plane.
    inlier_mask_ : (n,) bool array
        Rows that are within 2.5 scales.
    """

    def __init__(self, sample_size: int | None = None, random_state: Any = 0) -> None:
        self.sample_size = sample_size
        self.random_state = random_state

    def fit(self, X: Any, y: Any) -> Self:
        """Learn the plane from inputs X (n, d) and outputs y (n,) or (n, outputs).

        Raises
        ------
        ValueError
            X or y is not a finite numeric array, or `sample_size` is not a positive integer.
        """
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        targets = np.asarray(y, dtype=np.float64).reshape(len(X), -1)
        design = np.hstack([X, np.ones((len(X), 1))])

        def plane(rows: IntArray) -> FloatArray:
            solution: FloatArray = np.linalg.lstsq(design[rows], targets[rows], rcond=None)[0]
            return solution

        seed = check_random_state(self.random_state).randint(2**31 - 1)
        found = least_median(
            plane,
            lambda model: np.linalg.norm(targets - design @ model, axis=1, keepdims=True),
            len(X),
            sample_size=self._rows_a_sample(*design.shape),
            rng=np.random.default_rng(seed),
            dimension=targets.shape[1],
        )
        slopes, level = found.model[:-1].T, found.model[-1]
        self.coef_ = slopes if np.ndim(y) > 1 else slopes[0]
        self.intercept_ = level if np.ndim(y) > 1 else float(level[0])
        self.scale_ = float(found.scales[0])
        self.inlier_mask_ = found.inliers
        return self

    def predict(self, X: Any) -> FloatArray:
        """Return the plane's values, shaped as the outputs were, at X (n, d)."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        values: FloatArray = X @ self.coef_.T + self.intercept_
        return values

    def _rows_a_sample(self, n: int, coefficients: int) -> int:
        size = coefficients if self.sample_size is None else self.sample_size
        if not isinstance(size, Integral) or size < 1:
            raise ValueError(f"sample_size must be a positive integer or None, got {self.sample_size!r}.")
        return min(n, int(size))
