"""What the sparse posterior needs of all samples: sums over them, which can be added to and taken from.

With `L L^T = K_zz` and `V = L^-1 K_zx` the variational posterior (Titsias 2009) needs of n samples only `G = V V^T`
and `V y`. So data may come in parts (Bui et al. 2017, for fixed inducing points and hyperparameters), and a part may
be left out again, at a cost that knows nothing of the other samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import blas, cho_factor, cho_solve, solve_triangular

from gpcorrect.gpr.kernels import Kernel
from gpcorrect.gpr.linalg import cholesky, triangular_inverse
from gpcorrect.gpr.predictor import Predictor, SharedPredictor
from gpcorrect.types import FloatArray, Progress

BLOCK = 2048  # rows at once: memory stays flat however many samples there are
NEGLIGIBLE = 1e-6  # directions along which the data take away less of the prior variance are left out of the predictor


@dataclass(frozen=True, eq=False)
class Statistics:
    """Samples as M inducing points see them.

    What the points cannot see of the field acts on the data like noise, so it is counted with the noise: without
    that, too few points for a rough field make an overconfident fit (docs/design/0002 has the figures).

    Parameters
    ----------
    G : (M, M) array, `V V^T`, symmetric
    Vy : (M, m) array, `V (y - offset)`, in the outputs' units
    n : float, samples; a fraction where some of them were given less weight
    inflation : float
        By how much the noise is multiplied, because neighbouring samples err together: so many count as one.
    """

    G: FloatArray
    Vy: FloatArray
    n: float
    inflation: float = 1.0

    def plus(self, other: Self, keep: float = 1.0) -> Statistics:
        """Return the statistics of these samples, weighted by `keep`, and the others in full, inflated as these.

        Parameters
        ----------
        other : Statistics, under the same points and hyperparameters
        keep : float
        """
        return replace(self, G=keep * self.G + other.G, Vy=keep * self.Vy + other.Vy, n=keep * self.n + other.n)

    def counted(self, times: int) -> Statistics:
        """Return the statistics where each sample stands for so many.

        Parameters
        ----------
        times : int
        """
        return replace(self, G=times * self.G, Vy=times * self.Vy, n=times * self.n)

    def minus(self, other: Self) -> Statistics:
        """Return the statistics without the others, which must be among them.

        Parameters
        ----------
        other : Statistics, under the same points and hyperparameters
        """
        return replace(self, G=self.G - other.G, Vy=self.Vy - other.Vy, n=self.n - other.n)

    def unseen(self, count: int) -> float:
        """Mean share of prior variance that the first `count` points leave at the samples.

        Parameters
        ----------
        count : int, at most M
        """
        return max(1.0 - float(np.trace(self.G[:count, :count])) / self.n, 0.0)

    def mean_weights(self, L: FloatArray, ratio: FloatArray) -> FloatArray:
        """Weights `(M, m)` of the correlations to all points in the mean, for noise over signal `(m,)`.

        Parameters
        ----------
        L : (M, M) array, Cholesky factor of the correlations of the points
        ratio : (m,) array, noise over signal variance
        """
        diagonal = np.diag_indices_from(self.G)
        solved = np.empty(self.Vy.shape)
        for o, noise in enumerate(self.inflation * ratio + self.unseen(len(self.G))):
            system = np.array(self.G, order="F")
            system[diagonal] += noise
            solved[:, o] = cho_solve(
                cho_factor(system, lower=True, overwrite_a=True, check_finite=False), self.Vy[:, o]
            )
        return np.asarray(solve_triangular(L, solved, lower=True, trans="T", check_finite=False))

    def variance_factors(self, L: FloatArray, ratio: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Projection `(r, count)` and explained shares `(m, r)` of the variance that the first `count` points give.

        Parameters
        ----------
        L, ratio
            As for :meth:`mean_weights`.
        count : int, at most M
        """
        eigenvalues, U = np.linalg.eigh(self.G[:count, :count])
        eigenvalues = np.maximum(eigenvalues, 0.0)
        explained = eigenvalues / (eigenvalues + (self.inflation * ratio + self.unseen(count))[:, None])
        chosen = explained.max(axis=0) > NEGLIGIBLE
        chosen[-1] = True  # an output of pure noise still needs a direction to say so
        projection = solve_triangular(L[:count, :count], U[:, chosen], lower=True, trans="T", check_finite=False).T
        return projection, explained[:, chosen]


@dataclass(frozen=True, eq=False)
class Points:
    """M inducing points of outputs that share a kernel."""

    kernel: Kernel  # in the units of the inputs
    basis: FloatArray  # (M, d)
    L: FloatArray  # (M, M) Cholesky factor of their correlations
    offset: FloatArray  # (m,) mean far from all data
    # (m,) each: prior and noise variances
    signal: FloatArray
    noise: FloatArray
    n_variance: int  # how many of them, the first, the variance rests on

    @classmethod
    def of(cls, part: SharedPredictor) -> Self:
        """Return the points and hyperparameters that a predictor rests on.

        Parameters
        ----------
        part : SharedPredictor
        """
        L = cholesky(part.kernel(part.basis, part.basis))[0]
        return cls(part.kernel, part.basis, L, part.offset, part.signal, part.noise, part.projection.shape[1])

    def collect(self, X: FloatArray, Y: FloatArray, progress: Progress, terms: FloatArray | None = None) -> Statistics:
        """Sum over samples in blocks: memory does not grow with their number.

        Parameters
        ----------
        X, Y : (n, d) and (n, m) arrays, inputs and outputs
        progress : Progress, updated after each block
        terms : (n, k) array, optional, further columns that stand behind the outputs, not centred
        """
        columns = Y - self.offset if terms is None else np.hstack([Y - self.offset, terms])
        G, Vy = np.zeros(self.L.shape, order="F"), np.zeros((len(self.basis), columns.shape[1]))
        inverse = triangular_inverse(self.L)
        for start in range(0, len(X), BLOCK):
            rows = slice(start, start + BLOCK)
            V = blas.dtrmm(1.0, inverse, self.kernel(X[rows], self.basis).T, lower=1, overwrite_b=1)
            G = blas.dsyrk(1.0, V, beta=1.0, c=G, lower=1, overwrite_c=1)
            Vy += V @ columns[rows]
            progress.step("posterior", min(1.0, (start + BLOCK) / len(X)))
        return Statistics(np.tril(G) + np.tril(G, -1).T, Vy, float(len(X)))

    def posterior(self, statistics: Statistics) -> SharedPredictor:
        """Return the predictor of these statistics.

        Parameters
        ----------
        statistics : Statistics
        """
        ratio = self.noise / self.signal
        projection, explained = statistics.variance_factors(self.L, ratio, min(self.n_variance, len(self.basis)))
        return SharedPredictor(
            kernel=self.kernel,
            basis=self.basis,
            alpha=statistics.mean_weights(self.L, ratio).T,
            offset=self.offset,
            projection=projection,
            explained=explained,
            signal=self.signal,
            noise=self.noise,
        )


def collected(points: Sequence[Points], X: FloatArray, Y: FloatArray) -> tuple[Statistics, ...]:
    """Return the statistics of samples, see :meth:`Points.collect`.

    Parameters
    ----------
    points : sequence of Points, of each group of outputs
    X, Y : (n, d) and (n, m) arrays, inputs and outputs, the groups' one after the other
    """
    stops = np.cumsum([len(own.offset) for own in points])[:-1]
    pairs = zip(points, np.split(Y, stops, axis=1), strict=True)
    return tuple(own.collect(X, columns, Progress()) for own, columns in pairs)


def resting_on(points: Sequence[Points], statistics: Sequence[Statistics]) -> Predictor:
    """Return the predictor of statistics under points and hyperparameters that stand.

    Parameters
    ----------
    points : sequence of Points, of each group of outputs
    statistics : sequence of Statistics, likewise
    """
    return Predictor(tuple(own.posterior(sums) for own, sums in zip(points, statistics, strict=True)))
