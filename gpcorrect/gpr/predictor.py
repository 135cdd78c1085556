"""Predictions from factors computed once: of one input in machine code, without BLAS or Python, and of many.

With correlations k to the basis points the mean of output o is `k^T alpha_o` and its latent variance `s_o (1 - sum_j
c_oj w_j^2)`, `w = P k`: the shared kernel lets one product `P k` serve every output, whatever its noise
(docs/design/0002). Squared distances to them are linear in the input but for one number a component. One thread and no
library's thread pool, so a query never waits for another's.

All compiled code is in this file: numba's cache notices a change of the file that holds the outermost function only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.errors import DataError
from gpcorrect.gpr.kernels import Kernel
from gpcorrect.types import FloatArray, frozen_array

# Sums may be taken in any order, so that they are vectorised; NaN and infinity keep their meaning.
LOOSE = {"reassoc", "contract", "nsz"}
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits of a double
LOG2_E = 1.4426950408889634  # 1 / ln 2
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10  # ln 2 in two parts (Cody and Waite 1980)
LOWEST = -700.0  # exp below it is as good as zero, and 2^n would leave the normal numbers
MANTISSA_BITS, EXPONENT_BIAS = 52, 1023
BLOCK = 2048  # rows predicted at once: memory stays flat however many are asked


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


@dataclass(frozen=True, eq=False)
class SharedPredictor:
    """Everything a prediction needs, as read-only arrays: it changes nothing, so threads may share it.

    Parameters
    ----------
    kernel : Kernel, Correlation, in the inputs' units
    basis : (p, d) array, points that predictions rest on: the inducing points, or the training inputs
    alpha : (m, p) array, weights of the mean, in the outputs' units
    offset : (m,) array, mean far from all data
    projection : (r, q) array
        P above, over the first q <= p basis points: the variance may rest on fewer points than the mean. Rounded to
        single precision, which moves a standard deviation by some 1e-6 of itself: it is most of what a query reads,
        and half the bytes stay in the processor's cache.
    explained : (m, r) array, c above: the share of prior variance that the data take away along each direction
    signal, noise : (m,) arrays, prior variance and noise variance, in squared units of the outputs
    """

    kernel: Kernel
    basis: FloatArray
    alpha: FloatArray
    offset: FloatArray
    projection: FloatArray
    explained: FloatArray
    signal: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        # C order always: another layout would round otherwise, and a reloaded model must answer to the last bit.
        for name in (f.name for f in fields(self) if f.name != "kernel"):
            object.__setattr__(self, name, frozen_array(np.ascontiguousarray(getattr(self, name))))
        object.__setattr__(self, "projection", frozen_array(self.projection.astype(np.float32).astype(np.float64)))
        # Refused before compiled code, which does not look, reads them.
        (p, d), (r, q), m = self.basis.shape, self.projection.shape, self.offset.size
        shapes = {"alpha": (m, p), "offset": (m,), "explained": (m, r), "signal": (m,), "noise": (m,)}
        found = {name: getattr(self, name).shape for name in shapes}
        scales = self.kernel.length_scales.shape
        if found != shapes or not 0 < q <= p or scales != (self.kernel.weights.size, d):
            raise DataError(
                f"a predictor of {m} outputs on {p} points of {d} inputs does not fit together:"
                f" {found}, projection {(r, q)}, length scales {scales}."
            )

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Predict inputs `(n, d)`: means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)`.

        Parameters
        ----------
        X : (n, d) array
        """
        n, m = len(X), len(self.offset)
        mean, std, novelty = np.empty((n, m)), np.empty((n, m)), np.empty(n)
        for start in range(0, n, BLOCK):
            rows = slice(start, start + BLOCK)
            K = self.kernel(X[rows], self.basis)
            W = K[:, : self.projection.shape[1]] @ self.projection.T
            left = np.maximum(1.0 - (W * W) @ self.explained.T, 0.0)
            mean[rows] = K @ self.alpha.T + self.offset
            std[rows] = np.sqrt(left * self.signal + self.noise)
            novelty[rows] = left.min(axis=1)
        return mean, std, novelty


def _tables(parts: Sequence[SharedPredictor]) -> Tables:
    """Return what queries of these groups of outputs read; padding changes no answer."""
    own = [name for name in Tables._fields if name in SharedPredictor.__annotations__]
    columns = [
        (*part.kernel.table(part.basis), *(getattr(part, name) for name in own), np.array([float(len(part.offset))]))
        for part in parts
    ]
    stacked = Tables(*(_stack(arrays) for arrays in zip(*columns, strict=True)))
    return stacked._replace(projection=stacked.projection.astype(np.float32))


def _stack(arrays: Sequence[FloatArray]) -> FloatArray:
    """Stack arrays, shorter ones filled up with zeros."""
    shape = np.max([array.shape for array in arrays], axis=0).astype(np.int64)
    stacked = np.zeros((len(arrays), *shape))
    for row, array in zip(stacked, arrays, strict=True):
        row[tuple(slice(n) for n in array.shape)] = array
    return stacked


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictions of all outputs; it changes nothing, so threads may share it.

    Parameters
    ----------
    parts : tuple of SharedPredictor, one for each group of outputs, in the order of the outputs

    Attributes
    ----------
    tables : Tables, the same as a single query reads it
    """

    parts: tuple[SharedPredictor, ...]
    tables: Tables = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len({part.basis.shape[1] for part in self.parts}) != 1:
            raise DataError("the groups of outputs of a predictor look at different numbers of inputs.")
        object.__setattr__(self, "tables", _tables(self.parts))
        self.mean_std(self.parts[0].basis[0])  # compiled here (or read from numba's cache), never in the first query

    def mean_std(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Predict one input: mean and standard deviation `(m,)` of a new observation, and novelty.

        The novelty is the fraction of the prior variance that is left, of the group known least: 0 amid data, 1 far.

        Parameters
        ----------
        x : (d,) array

        Raises
        ------
        DataError
            The input has another length.
        """
        if len(x) != self.tables.origin.shape[1]:  # compiled code does not look
            raise DataError(f"a predictor of {self.tables.origin.shape[1]} inputs was asked about {len(x)}.")
        # A copy: another layout or a read-only array would be compiled for anew.
        return _predict_one(np.array(x, dtype=np.float64), self.tables)

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Predict inputs `(n, d)`: means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)`.

        Parameters
        ----------
        X : (n, d) array
        """
        means, stds, novelties = zip(*[part.mean_std_batch(X) for part in self.parts], strict=True)
        return np.concatenate(means, axis=1), np.concatenate(stds, axis=1), np.max(novelties, axis=0)


@njit(cache=True, nogil=True, fastmath=LOOSE)
def _predict_one(x: FloatArray, t: Tables) -> tuple[FloatArray, FloatArray, float]:
    """Predict one input `(d,)`: means `(m,)`, standard deviations `(m,)` and novelty of all outputs.

    The novelty is the least share of prior variance left over the outputs of a group, and the largest over groups.
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
