"""Held-out evidence of linear models: gains of log-likelihood, in nats, on trajectories that the fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray, IntArray

FOLDS = 5  # of cross-validation over whole trajectories: chosen by hand


@dataclass(frozen=True, eq=False)
class Grams:
    """Sums of products of p whitened columns over each of b blocks, which is what least squares needs of them."""

    gram: FloatArray  # (b, p, p) with each other
    moment: FloatArray  # (b, p) with the whitened residual, or (b, p, r) with r of them


def grams(columns: FloatArray, residual: FloatArray, block: IntArray) -> Grams:
    """Return sums of products over each block.

    Parameters
    ----------
    columns : (n, p) array, whitened
    residual : (n,) or (n, r) array, whitened
    block : (n,) int array, label of each row, from 0 without gaps; -1 is left out
    """
    n_blocks, p = int(block.max(initial=-1)) + 1, columns.shape[1]
    gram, moment = np.zeros((n_blocks, p, p)), np.zeros((n_blocks, p, *residual.shape[1:]))
    order, ends = _by_block(block, n_blocks)
    x, y = columns[order], residual[order]
    for b in range(n_blocks):
        rows = slice(ends[b], ends[b + 1])
        gram[b], moment[b] = x[rows].T @ x[rows], x[rows].T @ y[rows]
    return Grams(gram, moment)


def bordered(base: Grams, columns: FloatArray, new: FloatArray, residual: FloatArray, block: IntArray) -> Grams:
    """Return the sums of columns with further ones behind them.

    Parameters
    ----------
    base : Grams, of `columns`, known already
    columns : (n, p) array, whitened
    new : (n, q) array, further columns
    residual : (n,) array, whitened
    block : (n,) int array, label of each row, from 0 without gaps
    """
    n_blocks, p = base.moment.shape
    width = p + new.shape[1]
    gram, moment = np.zeros((n_blocks, width, width)), np.zeros((n_blocks, width))
    gram[:, :p, :p], moment[:, :p] = base.gram, base.moment
    order, ends = _by_block(block, n_blocks)
    _add_products(columns[order], new[order], residual[order], ends, gram, moment)
    return Grams(gram, moment)


@njit(cache=True)
def _add_products(
    columns: FloatArray, new: FloatArray, residual: FloatArray, ends: IntArray, gram: FloatArray, moment: FloatArray
) -> None:
    """Sum, over the rows of each block, the products of new columns with the known ones, themselves and a residual.

    Blocks are short and many: products of small matrices one block after the other cost more in calls than in sums.
    """
    known, width = columns.shape[1], gram.shape[1]
    for b in range(len(ends) - 1):
        for row in range(ends[b], ends[b + 1]):
            for i in range(known, width):
                value = new[row, i - known]
                if value == 0.0:
                    continue
                for k in range(known):
                    gram[b, i, k] += value * columns[row, k]
                for k in range(known, i + 1):
                    gram[b, i, k] += value * new[row, k - known]
                moment[b, i] += value * residual[row]
        for i in range(known, width):
            for k in range(i):
                gram[b, k, i] = gram[b, i, k]


def _by_block(block: IntArray, n_blocks: int) -> tuple[IntArray | slice, IntArray]:
    """Rows in the order of their blocks, and where each block's begin (and the last one's end)."""
    if (block[1:] >= block[:-1]).all():  # rows that stand in order are not copied
        return slice(None), np.searchsorted(block, np.arange(n_blocks + 1))
    order = np.argsort(block, kind="stable")
    return order, np.searchsorted(block[order], np.arange(n_blocks + 1))


def fold_of(n_blocks: int) -> IntArray:
    """Return the fold of each block, dealt in turn.

    Parameters
    ----------
    n_blocks : int
    """
    return np.arange(n_blocks) % max(2, min(FOLDS, n_blocks))


def solve(gram: FloatArray, moment: FloatArray, ridge: float = 1e-6) -> FloatArray:
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
    dead = energy <= 1e-12 * np.maximum(energy.max(axis=-1, initial=0.0, keepdims=True), 1e-300)
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
    data: Grams, fold: IntArray, prior_precision: float | FloatArray = 0.0, ridge: float = 1e-6
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
