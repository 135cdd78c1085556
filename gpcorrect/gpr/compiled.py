"""The hot path in machine code: mean, deviation and novelty of all outputs for one input, without BLAS or Python.

With correlations k to the basis points the mean of output o is `k^T alpha_o` and its latent variance `s_o (1 - sum_j
c_oj w_j^2)`, `w = P k`: the shared kernel lets one product `P k` serve every output, whatever its noise
(docs/design/0002). Squared distances to them are linear in the input but for one number a component. One thread and no
library's thread pool, so a query never waits for another's.

All of it is in one file: numba's cache notices a change of the file that holds the outermost function, and no other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray

# Sums may be taken in any order, so that they are vectorised; NaN and infinity keep their meaning.
LOOSE = {"reassoc", "contract", "nsz"}
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits of a double
LOG2_E = 1.4426950408889634  # 1 / ln 2
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10  # ln 2 in two parts (Cody and Waite 1980)
LOWEST = -700.0  # exp below it is as good as zero, and 2^n would leave the normal numbers
MANTISSA_BITS, EXPONENT_BIAS = 52, 1023


class Tables(NamedTuple):
    """What a query reads, for g groups of m outputs (short ones padded), c components, d features, p and q points.

    The first six are those of :class:`gpcorrect.gpr.kernels.KernelTable`, a group each. `sizes` `(g, 1)` are the
    numbers of outputs; `projection` is in single precision.
    """

    code: FloatArray
    origin: FloatArray
    inverse: FloatArray
    slopes: FloatArray
    levels: FloatArray
    log_weights: FloatArray
    alpha: FloatArray
    offset: FloatArray
    projection: FloatArray
    explained: FloatArray
    signal: FloatArray
    noise: FloatArray
    sizes: FloatArray


@njit(cache=True, nogil=True, fastmath=LOOSE)
def predict_one(x: FloatArray, t: Tables) -> tuple[FloatArray, FloatArray, float]:
    """Predict one input `(d,)`: means `(m,)`, standard deviations `(m,)` and novelty of all outputs.

    The novelty is the least share of prior variance left over the outputs of a group, and the largest over groups.

    Parameters
    ----------
    x : (d,) array, input
    t : Tables, from the predictor
    """
    total = 0
    for g in range(len(t.sizes)):
        total += int(t.sizes[g, 0])
    mean, std, novelty, first = np.empty(total), np.empty(total), 0.0, 0
    k, w2 = np.empty(t.levels.shape[2]), np.empty(t.projection.shape[1])
    for g in range(len(t.sizes)):
        _correlations(x, g, t, k)
        _squared_projection(t.projection[g], k, w2)
        least = 1.0
        for m in range(int(t.sizes[g, 0])):
            left = max(1.0 - _dot(t.explained[g, m], w2), 0.0)
            mean[first + m] = t.offset[g, m] + _dot(t.alpha[g, m], k)
            std[first + m] = np.sqrt(left * t.signal[g, m] + t.noise[g, m])
            least = min(least, left)
        first += int(t.sizes[g, 0])
        novelty = max(novelty, least)
    return mean, std, novelty


@njit(cache=True, nogil=True, fastmath=LOOSE)
def _correlations(x: FloatArray, g: int, t: Tables, k: FloatArray) -> None:
    """Correlations `(p,)` of one input with the basis, written to `k`."""
    exponents, scratch = np.empty(len(k)), np.empty(len(k))
    matern52 = t.code[g, 0] == 1.0
    for j in range(len(k)):
        k[j] = 0.0
    for c in range(t.levels.shape[1]):
        offset = 0.0 if matern52 else t.log_weights[g, c]
        for j in range(len(k)):
            exponents[j] = t.levels[g, c, j] + offset
        for d in range(len(x)):
            inverse = t.inverse[g, c, d]
            if inverse > 0.0:
                u = x[d] - t.origin[g, d]
                slope, drop = t.slopes[g, c, d], inverse * u * u
                for j in range(len(k)):
                    exponents[j] += u * slope[j] - drop
        if matern52:
            _add_matern52(exponents, scratch, t.log_weights[g, c], k)
        else:
            _add_exp(exponents, scratch, k)


@njit(cache=True, nogil=True, fastmath=LOOSE)
def _add_matern52(x: FloatArray, scratch: FloatArray, log_weight: float, total: FloatArray) -> None:
    """Add `exp(log_weight) (1 + r + r^2 / 3) exp(-r)`, `r = sqrt(5 s)`, to `total`, given `x = -s / 2`."""
    factor, decay = np.empty(len(x)), np.empty(len(x))
    for j in range(len(x)):
        decay[j] = 0.0
        r = np.sqrt(10.0 * max(-x[j], 0.0))
        factor[j] = 1.0 + r + r * r / 3.0
        x[j] = log_weight - r
    _add_exp(x, scratch, decay)
    for j in range(len(x)):
        total[j] += factor[j] * decay[j]


@njit(cache=True, nogil=True, fastmath={"contract"})  # said, or the caller's would hold: x + ROUND - ROUND must stay
def _add_exp(x: FloatArray, scratch: FloatArray, total: FloatArray) -> None:
    """Add `exp(x)` to `total`, to 1e-15 of it; `x` and `scratch` are used up. Calls of exp take five times as long.

    `exp(x) = 2^n exp(r)`, `|r| <= ln 2 / 2`: Taylor's polynomial to r^13 for the latter, the bits of a double for 2^n.
    """
    bits = scratch.view(np.int64)
    for j in range(len(x)):
        value = max(x[j], LOWEST)
        shifted = value * LOG2_E + ROUND
        n = shifted - ROUND
        r = (value - n * LN2_HIGH) - n * LN2_LOW
        s = r * (1.0 / 6227020800.0) + 1.0 / 479001600.0
        s = s * r + 1.0 / 39916800.0
        s = s * r + 1.0 / 3628800.0
        s = s * r + 1.0 / 362880.0
        s = s * r + 1.0 / 40320.0
        s = s * r + 1.0 / 5040.0
        s = s * r + 1.0 / 720.0
        s = s * r + 1.0 / 120.0
        s = s * r + 1.0 / 24.0
        s = s * r + 1.0 / 6.0
        x[j] = ((s * r + 0.5) * r + 1.0) * r + 1.0
        scratch[j] = shifted
    for j in range(len(x)):
        bits[j] = (bits[j] + EXPONENT_BIAS) << MANTISSA_BITS
    for j in range(len(x)):
        total[j] += x[j] * scratch[j]


@njit(cache=True, nogil=True, fastmath=LOOSE)
def _squared_projection(projection: FloatArray, k: FloatArray, w2: FloatArray) -> None:
    """Squares `(r,)` of `P k`, over the first points of k."""
    for i in range(len(projection)):
        w = _dot(projection[i], k)
        w2[i] = w * w


@njit(cache=True, nogil=True, fastmath=LOOSE)
def _dot(a: FloatArray, b: FloatArray) -> float:
    """Sum of products over the length of `a`."""
    total = 0.0
    for j in range(len(a)):
        total += a[j] * b[j]
    return total
