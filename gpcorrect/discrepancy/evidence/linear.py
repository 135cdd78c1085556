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

    gram: FloatArray  # (b, p, p) with each other
    moment: FloatArray  # (b, p) with the whitened residual, or (b, p, r) with r of them


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

    The normal equations of the known columns are solved once for all sets, each of which then has its Schur complement.

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
        parts = self._products(new, rows)
        whole = tuple(a.sum(axis=0) for a in parts)
        factors, nats = self._solved(*whole)[1], np.full(new.shape[1], -self._nats)
        for i in range(len(self._sums.gram)):
            known, beta = self._solved(*(a - part[i] for a, part in zip(whole, parts, strict=True)))
            gram, moment, cross, own, right = (part[i] for part in parts)
            nats += moment @ known - 0.5 * np.einsum("ps,ps->s", known, gram @ known)
            left = right - np.einsum("psk,ps->sk", cross, known) - 0.5 * np.einsum("skl,sl->sk", own, beta)
            nats += np.einsum("sk,sk->s", beta, left)
        return factors, nats

    def _products(self, new: FloatArray, rows: BoolArray) -> tuple[FloatArray, ...]:
        """Sum over each fold: products of the known columns, of both, of each set's own, and with the residual."""
        (_, s, k), n_folds = new.shape, len(self._sums.gram)
        fold, columns, residual = self._fold[rows], self._known[rows], self._residual[rows]
        cross, own = np.empty((n_folds, columns.shape[1], s, k)), np.empty((n_folds, s, k, k))
        right = np.empty((n_folds, s, k))
        for i in range(n_folds):
            part = fold == i
            x = new[part]
            cross[i] = (columns[part].T @ x.reshape(-1, s * k)).reshape(-1, s, k)
            own[i] = np.einsum("nsk,nsl->skl", x, x)
            if i in self._taken:  # from the others' products it is gone already
                off = np.einsum("nr,nsk->rsk", self._taken[i][rows[self._fold == i]], x)
                own[i] -= np.einsum("rsk,rsl->skl", off, off)
            right[i] = (residual[part] @ x.reshape(-1, s * k)).reshape(s, k)
        return self._sums.gram, self._sums.moment, cross, own, right

    def _solved(
        self, gram: FloatArray, moment: FloatArray, cross: FloatArray, own: FloatArray, right: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Factors of the known columns `(p, s)` beside each set, and of the set's own `(s, k)`."""
        p, s, k = cross.shape
        found = solve(gram, np.concatenate([moment[:, None], cross.reshape(p, s * k)], axis=1))
        alone, taken = found[:, 0], found[:, 1:].reshape(p, s, k)
        energy = np.diagonal(own, axis1=1, axis2=2)
        dead = energy <= DEAD * max(float(np.diagonal(gram).max(initial=0.0)), 1e-300)
        left = own - np.einsum("psk,psl->skl", cross, taken)
        left[:, np.arange(k), np.arange(k)] += np.where(dead, 1.0, RIDGE * energy)
        off = dead[:, :, None] | dead[:, None, :]
        left = np.where(off & ~np.eye(k, dtype=np.bool_), 0.0, left)
        asked = np.where(dead, 0.0, right - np.einsum("psk,p->sk", cross, alone))
        beta: FloatArray = np.linalg.solve(left, asked[:, :, None])[:, :, 0]
        return alone[:, None] - np.einsum("psk,sk->ps", taken, beta), beta


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
    """Gain in nats of each block `(b,)` (or `(b, r)`), its coefficients fitted to the other folds' blocks.

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
    gram[:, np.arange(gram.shape[1]), np.arange(gram.shape[1])] += prior_precision
    beta = solve(gram, moment, ridge)[place]
    half = data.gram @ beta if beta.ndim == 3 else (data.gram @ beta[..., None])[..., 0]
    gains: FloatArray = (beta * (data.moment - 0.5 * half)).sum(axis=1)
    return gains
