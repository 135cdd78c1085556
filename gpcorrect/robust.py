"""Robust scales: the standard deviation that the nearer half of the data speaks for."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaincinv

from gpcorrect.types import FloatArray, IntArray


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


def medians_of(values: FloatArray, label: IntArray) -> FloatArray:
    """Return the median `(k,)` of the values of each label; NaN where one of them is, as the median of all is.

    Parameters
    ----------
    values : (n,) array
    label : (n,) int array, 0 to k - 1, of none of which there is nothing
    """
    order, counts = np.lexsort((values, label)), np.bincount(label)
    sorted_values, first = values[order], np.cumsum(counts) - counts
    middle: FloatArray = (sorted_values[first + (counts - 1) // 2] + sorted_values[first + counts // 2]) / 2.0
    return np.where(np.isnan(sorted_values[first + counts - 1]), np.nan, middle)
