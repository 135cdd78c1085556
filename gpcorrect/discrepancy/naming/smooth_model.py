"""What no effect of the catalogue says: a smooth model of the residual, in all variables and its strongest pairs.

Piecewise linear in each variable, with a ridge whose strength is chosen on held-out trajectories: the additive-plus-
pairwise Gaussian process of the method note, in a basis that is cheap to refit. It is fitted together with the effects'
tangents, so that what it gains beside a set is orthogonal to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from gpcorrect.discrepancy.evidence.linear import fold_of, grams, held_out_nats, solve
from gpcorrect.discrepancy.evidence.variables import Cells
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.linearisation import linearise
from gpcorrect.discrepancy.search.state import View
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import BoolArray, FloatArray

KNOTS = {1: 8, 2: 5}
PRECISIONS = (1.0, 10.0, 100.0)  # of a column's size, in units of the residual's mean square


def smooth_columns(view: View, fitted: Sequence[FittedEffect], channels: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return whitened columns `(N, k)` of the smooth model, in the rows of its channels, on discovery and confirmation.

    Of all single variables, states with a memory, and the pairs that explain most of what a set leaves.

    Parameters
    ----------
    view : View
    fitted : sequence of FittedEffect, the set
    channels : (c,) bool array, those that the model speaks of
    """
    residual, rows = view.search.residual(fitted), view.search.dataset.discovery
    parts: tuple[list[FloatArray], ...] = ([], [])
    numbers = np.arange(len(channels))
    for i in np.flatnonzero(channels).tolist():
        inputs = view.prepared.inputs[i]
        pairs = [t for t in view.prepared.tests[i] if len(t.variables) == 2]
        strongest = np.argsort([_explained(t, residual[:, i], rows) for t in pairs])[::-1][: NAMING.smooth_pairs]
        chosen = [*((name,) for name in inputs.values), *(pairs[k].variables for k in strongest)]
        bases = [_basis([inputs.values[v] for v in variables]) for variables in chosen]
        if inputs.memory:
            states = np.stack(inputs.memory, axis=1)
            bases.append(states / states.std(axis=0))
        for part, white in zip(parts, view.whitened(np.concatenate(bases, axis=1)[:, None], numbers == i), strict=True):
            part.append(white)
    discovery, confirmation = (block_diag(*part) for part in parts)
    return discovery, confirmation


def _basis(values: Sequence[FloatArray]) -> FloatArray:
    """Hat functions of one variable, or their products for two `(m, k)`."""
    hats = [_hats(v, KNOTS[len(values)]) for v in values]
    if len(hats) == 1:
        return hats[0]
    product: FloatArray = (hats[0][:, :, None] * hats[1][:, None, :]).reshape(len(hats[0]), -1)
    return product


def _hats(values: FloatArray, n_knots: int) -> FloatArray:
    """Piecewise linear functions `(m, k)`, each one at one quantile (of few values: at one of them), zero at others."""
    distinct = np.unique(values)
    knots = distinct if len(distinct) <= n_knots else np.unique(np.quantile(values, np.linspace(0, 1, n_knots)))
    columns: FloatArray = np.stack([np.interp(values, knots, unit) for unit in np.eye(len(knots))], axis=1)
    return columns


def _explained(cells: Cells, residual: FloatArray, rows: BoolArray) -> float:
    """Variance between cells over variance, on finite rows."""
    good = rows & np.isfinite(residual)
    code, value = cells.code[good], residual[good]
    count = np.bincount(code)
    mean = np.bincount(code, value) / np.maximum(count, 1)
    return float((count * (mean - value.mean()) ** 2).sum() / max(((value - value.mean()) ** 2).sum(), 1e-300))


def smooth_nats(
    view: View, fitted: Sequence[FittedEffect], channels: BoolArray, columns: tuple[FloatArray, FloatArray]
) -> float:
    """Return the log Bayes factor of smooth columns beyond a set, on discovery (held out) and confirmation.

    Parameters
    ----------
    view : View
    fitted : sequence of FittedEffect, the set; the tangents of its effects take up what they can
    channels : (c,) bool array, those that the columns speak of
    columns : pair of (N, k) arrays, whitened on both parts, in the rows of these channels
    """
    search, k = view.search, columns[0].shape[1]
    if k == 0:
        return 0.0
    touching = [m for m in fitted if (search.touched(m.candidate) & channels).any()]
    others = [m for m in fitted if not any(m is t for t in touching)]
    discovery = linearise(search.whitener, touching, others)
    confirmation = linearise(view.confirmation, touching, others)
    size = float(np.sqrt(np.nanmean(search.residual(fitted)[search.dataset.discovery][:, channels] ** 2)))
    p, folds = discovery.slopes.shape[1], fold_of(int(search.whitener.block.max()) + 1)
    fold, of_folds = folds[search.whitener.block], np.arange(int(folds.max()) + 1)
    own = grams(discovery.slopes, discovery.z, fold)
    there, confirmed = (channels[w.channel] for w in (search.whitener, view.confirmation))
    columns_there = np.concatenate([discovery.slopes[there], columns[0]], axis=1)
    sums = grams(columns_there, discovery.z[there], fold[there], len(of_folds))
    sums.gram[:, :p, :p], sums.moment[:, :p] = own.gram, own.moment  # those of the rows of all channels
    priors = [np.r_[np.zeros(p), np.full(k, strength / size**2)] for strength in PRECISIONS]
    nats = [float(held_out_nats(sums, of_folds, prior).sum()) for prior in priors]
    best = int(np.argmax(nats))
    gram, moment = sums.gram.sum(axis=0), sums.moment.sum(axis=0)
    without = confirmation.z - confirmation.slopes @ solve(gram[:p, :p], moment[:p])
    beta = solve(gram + np.diag(priors[best]), moment)
    left = confirmation.z - confirmation.slopes @ beta[:p]
    left[confirmed] -= columns[1] @ beta[p:]
    gain = nats[best] - float(held_out_nats(own, of_folds).sum())
    return gain + 0.5 * float((without**2).sum() - (left**2).sum())
