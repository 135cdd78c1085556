"""Cholesky factors of covariances that rounding may have made slightly indefinite, and what follows from them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas, cho_solve, lapack, solve_triangular

from gpcorrect.errors import DegenerateError
from gpcorrect.gpr.kernels import Kernel, WithLinear
from gpcorrect.types import FloatArray, IntArray

FIRST_JITTER, LAST_JITTER = 1e-12, 1e-4  # relative to the mean of the diagonal; each try ten times the one before
SMALL = 64  # rows of a triangle that LAPACK inverts; changes the speed only


def cholesky(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Lower Cholesky factor of a symmetric matrix `(n, n)`, and the jitter that its diagonal needed for it.

    Jitter is relative to the mean of the diagonal: none first, then 1e-12, ten times more at each try, up to 1e-4.

    Parameters
    ----------
    matrix : (n, n) array, symmetric

    Raises
    ------
    DegenerateError
        The matrix is not a covariance even with the largest jitter.
    """
    unit = float(np.mean(np.diagonal(matrix)))
    jitter = 0.0
    while jitter <= LAST_JITTER:
        trial = np.array(matrix, order="C").T  # Fortran order for LAPACK, and symmetric: a straight copy
        trial[np.diag_indices_from(trial)] += jitter * unit
        factor, failed = lapack.dpotrf(trial, lower=1, clean=1, overwrite_a=1)
        if not failed:
            lower: FloatArray = factor
            return lower, jitter * unit
        jitter = max(10.0 * jitter, FIRST_JITTER)
    raise DegenerateError(
        f"a covariance of {len(matrix)} points is not positive definite even with {LAST_JITTER} of its diagonal added.",
        hint="Look for inputs that are not finite or features of wildly different size.",
    )


def inverse_and_log_determinant(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Upper triangle of the inverse `(n, n)` of a covariance matrix (zeros below, C order), and its log determinant.

    Parameters
    ----------
    matrix : (n, n) array, covariance
    """
    factor, _ = cholesky(matrix)
    log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum())
    inverse, _ = lapack.dlauum(triangular_inverse(factor), lower=1, overwrite_c=1)
    return inverse.T, log_determinant


def triangular_inverse(L: FloatArray) -> FloatArray:
    """Return the inverse of a lower triangular matrix `(n, n)`, in Fortran order.

    By halves, `[[A, 0], [B, C]]^-1 = [[A^-1, 0], [-C^-1 B A^-1, C^-1]]`: LAPACK's own takes twice as long.

    Parameters
    ----------
    L : (n, n) array, lower triangular, its diagonal without zeros
    """
    if len(L) <= SMALL:
        inverse, _ = lapack.dtrtri(L, lower=1)
        return np.asfortranarray(inverse)
    half = len(L) // 2
    A, C, whole = triangular_inverse(L[:half, :half]), triangular_inverse(L[half:, half:]), np.zeros(L.shape, order="F")
    whole[:half, :half], whole[half:, half:] = A, C
    whole[half:, :half] = -blas.dtrmm(1.0, C, blas.dtrmm(1.0, A, L[half:, :half], side=1, lower=1), lower=1)
    return whole


def conditioned(
    kernel: Kernel | WithLinear, noise: float, X: FloatArray, Y: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of noisy observations, given others (Rasmussen and Williams 2006, Eq. 2.23).

    Parameters
    ----------
    kernel : Kernel or WithLinear, prior covariance
    noise : float, noise variance
    X, Y : (n, d) and (n, m) arrays, observations of outputs with zero prior mean
    at : (q, d) array, where to predict

    Returns
    -------
    mean : (q, m) array
    std : (q,) array, the same for all outputs; noise included
    """
    lower, _ = cholesky(kernel(X, X) + noise * np.eye(len(X)))
    cross = kernel(at, X)
    explained = (blas.dtrmm(1.0, triangular_inverse(lower), cross.T, lower=1) ** 2).sum(axis=0)
    return cross @ cho_solve((lower, True), Y), np.sqrt(np.maximum(kernel.diagonal(at) - explained, 0.0) + noise)


def conditioned_mean(
    kernel: Kernel | WithLinear, noise: float, X: FloatArray, Y: FloatArray, at: FloatArray
) -> FloatArray:
    """Return the mean `(q, m)` that :func:`conditioned` gives, without the cost of the deviations.

    Parameters
    ----------
    kernel, noise, X, Y, at
        As for :func:`conditioned`.
    """
    lower, _ = cholesky(kernel(X, X) + noise * np.eye(len(X)))
    return np.asarray(kernel(at, X) @ cho_solve((lower, True), Y))


def conditioned_on_others(
    kernel: Kernel | WithLinear,
    noise: float,
    known: tuple[FloatArray, FloatArray, IntArray],
    asked: tuple[FloatArray, IntArray],
) -> tuple[FloatArray, FloatArray]:
    """Return what :func:`conditioned` does, each row from the observations of the other folds.

    One factor serves all folds. With `A = K^-1`, and f the rows of a fold among the others o, the inverse of K_oo is
    `A_oo - A_of A_ff^-1 A_fo` (Rasmussen and Williams 2006, Sec. 5.4.2, of one row each).

    Parameters
    ----------
    kernel : Kernel or WithLinear, prior covariance
    noise : float, noise variance
    known : (n, d), (n, m) and (n,) arrays, observations of outputs with zero prior mean, and the fold of each
    asked : (q, d) and (q,) arrays, where to predict, and the fold that is left out there
    """
    (X, Y, folds), (at, left_out) = known, asked
    lower, _ = cholesky(kernel(X, X) + noise * np.eye(len(X)))
    root = triangular_inverse(lower)
    inverse = root.T @ root
    weights = inverse @ Y
    cross = kernel(at, X)
    cross[left_out[:, None] == folds] = 0.0
    explained = (blas.dtrmm(1.0, root, cross.T, lower=1) ** 2).sum(axis=0)
    mean = cross @ weights
    for fold in np.intersect1d(folds, left_out):
        own, here = folds == fold, left_out == fold
        block, _ = cholesky(inverse[np.ix_(own, own)])
        shared = solve_triangular(block, inverse[own], lower=True) @ cross[here].T
        explained[here] -= (shared**2).sum(axis=0)
        mean[here] -= shared.T @ solve_triangular(block, weights[own], lower=True)
    return mean, np.sqrt(np.maximum(kernel.diagonal(at) - explained, 0.0) + noise)
