"""Predictions from factors computed once: of one input (in machine code, see `compiled.py`) and of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.gpr.compiled import Tables, predict_one
from gpcorrect.gpr.kernels import Kernel
from gpcorrect.types import FloatArray, frozen_array

BLOCK = 2048  # rows predicted at once: memory stays flat however many are asked


@dataclass(frozen=True, eq=False)
class SharedPredictor:
    """Everything a prediction needs, as read-only arrays: it changes nothing, so threads may share it.

    P and c are those of `compiled.py`: `w = P k`, and the latent variance of output o is `s_o (1 - sum_j c_oj w_j^2)`.

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
    columns = [_group(part) for part in parts]
    stacked = Tables(*(_stack([column[i] for column in columns]) for i in range(len(Tables._fields))))
    return stacked._replace(projection=stacked.projection.astype(np.float32))


def _group(part: SharedPredictor) -> Tables:
    return Tables(
        *part.kernel.table(part.basis),
        alpha=part.alpha,
        offset=part.offset,
        projection=part.projection,
        explained=part.explained,
        signal=part.signal,
        noise=part.noise,
        sizes=np.array([len(part.offset)], dtype=np.float64),
    )


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

    @property
    def signal(self) -> FloatArray:
        """Prior variance `(m,)` of every output."""
        return np.concatenate([part.signal for part in self.parts])

    @property
    def noise(self) -> FloatArray:
        """Noise variance `(m,)` of every output."""
        return np.concatenate([part.noise for part in self.parts])

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
        return predict_one(np.array(x, dtype=np.float64), self.tables)

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Predict inputs `(n, d)`: means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)`.

        Parameters
        ----------
        X : (n, d) array
        """
        means, stds, novelties = zip(*[part.mean_std_batch(X) for part in self.parts], strict=True)
        return np.concatenate(means, axis=1), np.concatenate(stds, axis=1), np.max(novelties, axis=0)
