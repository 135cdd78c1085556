"""Robust scales: the standard deviation that the nearer half of the data speaks for."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaincinv

from gpcorrect.types import FloatArray


def _median_length(dimension: int) -> float:
    """Return the median length of a vector of unit normals: the root of the median of chi-squared."""
    return math.sqrt(2.0 * float(gammaincinv(dimension / 2.0, 0.5)))


MAD_TO_STD = 1.0 / _median_length(1)  # 1.4826: of normal data, standard deviation over median absolute deviation


def robust_scale(lengths: FloatArray, dimension: int = 1) -> FloatArray:
    """Return the standard deviation of a component, from the median length of residual vectors.

    Consistent for Gaussian residuals; up to half of the data may be arbitrarily wrong (Rousseeuw & Leroy 1987, Ch. 5).

    Parameters
    ----------
    lengths : (n,) or (n, k) array
        Lengths of n residual vectors, of each of k kinds.
    dimension : int, components that each vector has
    """
    return np.asarray(np.median(lengths, axis=0) / _median_length(dimension))
