"""Held-out evidence of linear models: gains of log-likelihood, in nats, on trajectories that the fit has not seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpcorrect.types import BoolArray, FloatArray, IntArray

FOLDS = 5  # of cross-validation over whole trajectories: chosen by hand
RIDGE = 1e-6  # of a column's energy
ALIKE = 1e-6  # singular values below: columns that say the same
DEAD = 1e-12  # of the largest energy: columns with less have none


@dataclass(frozen=True, eq=False)
class Grams:
    """Sums of products of p whitened columns over each of b blocks, which is what least squares needs of them."""

    gram: FloatArray  # (b, p, p) with each other; (b, s, p, p) of s sets of columns
    moment: FloatArray  # (b, p) with the whitened residual, (b, p, r) with r of them; (b, s, p) of s sets


def grams(columns: FloatArray, residual: FloatArray, block: IntArray, n_blocks: int | None = None) -> Grams:
    """Return sums of products over each block.

    Parameters
    ----------
    columns : (n, p) array, whitened
    residual : (n,) or (n, r) array, whitened
    block : (n,) int array, label of each row, from 0 without gaps; -1 is left out
    n_blocks : int, of which these rows may not have the last; by default as many as they have
    """
    n_blocks, p = int(block.max(initial=-1)) + 1 if n_blocks is None else n_blocks, columns.shape[1]
    gram, moment = np.zeros((n_blocks, p, p)), np.zeros((n_blocks, p, *residual.shape[1:]))
    for b in range(n_blocks):
        rows = block == b
        x = columns[rows]
        gram[b], moment[b] = x.T @ x, x.T @ residual[rows]
    return Grams(gram, moment)


@dataclass(frozen=True, eq=False)
class Apart:
    """Columns and a residual, in each fold apart from what shows in hardly any other.

    The number of such a column, a homing of a session with one motion, cannot be foretold, whatever is right: where a
    fold is held out it is fitted there (Frisch and Waugh 1933), beside a set and without it.
    """

    columns: FloatArray  # (n, p); nothing of those that are left out
    residual: FloatArray  # (n,)
    taken: Mapping[int, FloatArray]  # (rows of the fold, r) orthonormal, what is taken off in it

    @classmethod
    def of(cls, columns: FloatArray, residual: FloatArray, fold: IntArray, least: float) -> Apart:
        """Take off what the folds have for themselves.

        Parameters
        ----------
        columns : (n, p) array, whitened
        residual : (n,) array, whitened
        fold : (n,) int array
        least : float, part of a column's energy in other folds, from which its number can be foretold
        """
        energy = np.stack([(columns[fold == k] ** 2).sum(axis=0) for k in range(int(fold.max()) + 1)])
        alone = (energy.sum(axis=0) - energy < least * energy.sum(axis=0)) & (energy > 0.0)
        if not alone.any():
            return cls(columns, residual, {})
        columns, residual, taken = columns.copy(), residual.copy(), {}
        for k in np.flatnonzero(alone.any(axis=1)):
            rows = fold == k
            own = columns[np.ix_(rows, alone[k])]
            basis, sizes, _ = np.linalg.svd(own / np.linalg.norm(own, axis=0), full_matrices=False)
            taken[int(k)] = basis = basis[:, sizes > ALIKE * sizes[0]]
            columns[rows] -= basis @ (basis.T @ columns[rows])
            residual[rows] -= basis @ (basis.T @ residual[rows])
        columns[:, alone.any(axis=0)] = 0.0
        return cls(columns, residual, taken)


class Beside:
    """Least squares on known columns, and what further ones gain beside them, held out: many sets of them at once.

    Parameters
    ----------
    columns : (n, p) array, whitened
    residual : (n,) array, whitened
    block : (n,) int array, label of each row, from 0 without gaps
    least : float, see :meth:`Apart.of`
    """

    def __init__(self, columns: FloatArray, residual: FloatArray, block: IntArray, least: float = 0.0) -> None:
        self._fold = fold_of(int(block.max()) + 1)[block]  # evidence is summed over whole folds
        apart = Apart.of(columns, residual, self._fold, least)
        self._known, self._residual, self._taken = apart.columns, apart.residual, apart.taken
        self._sums = grams(self._known, self._residual, self._fold)
        of_folds = np.arange(len(self._sums.gram))
        self._nats = float(held_out_nats(self._sums, of_folds).sum()) if columns.shape[1] else 0.0

    def gains(self, new: FloatArray, rows: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the factors `(s, k)` of each set's columns on all blocks, and the nats `(s,)` that it gains.

        Parameters
        ----------
        new : (r, s, k) array, s sets of k columns, whitened, in the r rows where they are anything
        rows : (n,) bool array, which ones those are
        """
        data = self._with(new, rows)
        factors = solve(data.gram.sum(axis=0), data.moment.sum(axis=0))[:, -new.shape[2] :]
        return factors, held_out_nats(data, np.arange(len(data.gram))).sum(axis=0) - self._nats

    def _with(self, new: FloatArray, rows: BoolArray) -> Grams:
        """Return sums of products over f folds, of the known columns and each set's own, `(f, s, p + k, p + k)`."""
        (_, s, k), (n_folds, p) = new.shape, self._sums.moment.shape
        fold, columns, residual = self._fold[rows], self._known[rows], self._residual[rows]
        gram, moment = np.empty((n_folds, s, p + k, p + k)), np.empty((n_folds, s, p + k))
        gram[:, :, :p, :p], moment[:, :, :p] = self._sums.gram[:, None], self._sums.moment[:, None]
        for i in range(n_folds):
            part = fold == i
            x = new[part]
            cross = (columns[part].T @ x.reshape(-1, s * k)).reshape(p, s, k)
            gram[i, :, :p, p:], gram[i, :, p:, :p] = cross.swapaxes(0, 1), cross.transpose(1, 2, 0)
            gram[i, :, p:, p:] = np.einsum("nsk,nsl->skl", x, x)
            if i in self._taken:  # from the others' products it is gone already
                off = np.einsum("nr,nsk->rsk", self._taken[i][rows[self._fold == i]], x)
                gram[i, :, p:, p:] -= np.einsum("rsk,rsl->skl", off, off)
            moment[i, :, p:] = (residual[part] @ x.reshape(-1, s * k)).reshape(s, k)
        return Grams(gram, moment)


def fold_of(n_blocks: int) -> IntArray:
    """Return the fold of each block, dealt in turn.

    Parameters
    ----------
    n_blocks : int
    """
    return np.arange(n_blocks) % max(2, min(FOLDS, n_blocks))


def solve(gram: FloatArray, moment: FloatArray, ridge: float = RIDGE) -> FloatArray:
    """Least squares with a small ridge in units of the columns' own energy; columns without energy get zero.

    Parameters
    ----------
    gram : (..., p, p) array, products of the columns; leading axes are problems of their own
    moment : (..., p) array, or (..., p, r) for r right sides, products with what is to be explained
    ridge : float, added to the diagonal, in units of the columns' energy
    """
    single = moment.ndim == gram.ndim - 1
    right = moment[..., None] if single else moment
    energy = np.array(np.diagonal(gram, axis1=-2, axis2=-1))
    dead = energy <= DEAD * np.maximum(energy.max(axis=-1, initial=0.0, keepdims=True), 1e-300)
    energy[dead] = 1.0
    root = np.sqrt(energy)
    off = dead[..., :, None] | dead[..., None, :]
    scaled = np.where(off, 0.0, gram / (root[..., :, None] * root[..., None, :]))
    diagonal = np.arange(gram.shape[-1])
    scaled[..., diagonal, diagonal] += np.where(dead, 1.0, ridge)
    scaled_right = np.where(dead[..., None], 0.0, right / root[..., None])
    solution: FloatArray = np.linalg.solve(scaled, scaled_right) / root[..., None]
    return solution[..., 0] if single else solution


def held_out_nats(
    data: Grams, fold: IntArray, prior_precision: float | FloatArray = 0.0, ridge: float = RIDGE
) -> FloatArray:
    """Gain in nats of each block `(b,)` (`(b, r)`, `(b, s)`), its coefficients fitted to the other folds' blocks.

    Parameters
    ----------
    data : Grams
    fold : (b,) int array, fold of each block
    prior_precision : float or (p,) array
        Added to the normal equations' diagonal: shrinks coefficients that few samples speak of.
    ridge : float, see :func:`solve`
    """
    numbers, place = np.unique(fold, return_inverse=True)
    gram = data.gram.sum(axis=0) - np.stack([data.gram[fold == k].sum(axis=0) for k in numbers])
    moment = data.moment.sum(axis=0) - np.stack([data.moment[fold == k].sum(axis=0) for k in numbers])
    diagonal, single = np.arange(gram.shape[-1]), moment.ndim < gram.ndim
    gram[..., diagonal, diagonal] += prior_precision
    beta = solve(gram, moment, ridge)[place]
    half = (data.gram @ beta[..., None])[..., 0] if single else data.gram @ beta
    gains: FloatArray = (beta * (data.moment - 0.5 * half)).sum(axis=-1 if single else -2)
    return gains
