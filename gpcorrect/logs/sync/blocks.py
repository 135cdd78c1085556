"""Variances from residuals that are correlated in time: sums over blocks long enough to be independent."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

MIN_BLOCKS, MAX_BLOCKS = 12, 200  # fewer tell no variance, more cost time; chosen by hand
BLOCK_TIMES = 6.0  # a block is this many correlation times long: sums of blocks are then all but independent


def sandwich(score: FloatArray, hessian: FloatArray) -> tuple[FloatArray, int]:
    """Covariance `(p, p)` of an estimate from score `(n, p)` and Hessian `(p, p)`; degrees of freedom.

    The score is summed over blocks, whose sums are independent though the samples are not (Huber's sandwich,
    clustered).

    Parameters
    ----------
    score : (n, p) array, what each sample adds to the gradient, in order of time
    hessian : (p, p) array, of the whole loss
    """
    sums = block_sums(score)
    centred = sums - sums.mean(axis=0)
    blocks, p = sums.shape
    middle = centred.T @ centred * (blocks / (blocks - p))
    bread = np.linalg.pinv(hessian, rcond=1e-15, hermitian=True)
    return bread @ middle @ bread, blocks - p


def lost_freedom(residual: FloatArray, unknowns: int) -> float:
    """Factor of the variance for noise in residuals `(n, k)` that so many other fitted unknowns took up.

    Slow noise has few independent samples, and every unknown follows one.

    Parameters
    ----------
    residual : (n, k) array, in order of time
    unknowns : int, fitted beside what the variance is of
    """
    times = [_correlation_time(column) for column in residual.T]
    free = len(residual) / float(np.median(times))
    return free / max(free - unknowns, 1.0)


def block_sums(series: FloatArray) -> FloatArray:
    """Sum rows to `(b, p)` over blocks long against the first column's correlation time.

    Parameters
    ----------
    series : (n, p) array, in order of time
    """
    n = len(series)
    length = BLOCK_TIMES * _correlation_time(series[:, 0])
    blocks = int(np.clip(n / length, min(MIN_BLOCKS, n), MAX_BLOCKS))
    edges = np.linspace(0, n, blocks + 1).astype(int)[:-1]
    return np.add.reduceat(series, edges, axis=0)


def _correlation_time(series: FloatArray) -> float:
    """Integrated autocorrelation time in samples, up to the first lag at which none is left (Sokal 1997)."""
    x = series - series.mean()
    n = len(x)
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    covariance = np.fft.irfft(spectrum)[:n]
    if covariance[0] <= 0:
        return 1.0
    rho = covariance / covariance[0]
    gone = np.flatnonzero(rho < 0.05)
    stop = int(gone[0]) if gone.size else n
    return max(1.0, 1.0 + 2.0 * float(rho[1:stop].sum()))
