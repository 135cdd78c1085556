"""What no effect of the catalogue says.

A smooth model of the residual, additive in all variables plus its strongest pairs.

Piecewise linear in each variable, with a ridge whose strength is chosen on held-out trajectories: the additive-plus-
pairwise Gaussian process of the method note, in a basis that is cheap to refit. It is fitted together with the effects'
tangents, so that what it gains beside a set is orthogonal to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.linear import fold_of, held_out_nats, solve
from gpcorrect.discrepancy.evidence.variables import Cells, Covariates
from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import BoolArray, FloatArray

KNOTS = {1: 8, 2: 5}
PRECISIONS = (1.0, 10.0, 100.0)  # of a column's size, in units of the residual's mean square


@dataclass(frozen=True)
class SmoothFit:
    """Gain of the smooth model, beyond the set it was put beside.

    Parameters
    ----------
    discovery : float
        Held-out nats on the discovery part.
    confirmation : float
        Nats on the confirmation part, fitted on discovery.
    """

    discovery: float
    confirmation: float

    @property
    def nats(self) -> float:
        """Both."""
        return self.discovery + self.confirmation


def smooth_columns(
    inputs: Sequence[Covariates],
    tests: Sequence[Sequence[Cells]],
    channels: BoolArray,
    residual: FloatArray,
    rows: BoolArray,
) -> FloatArray:
    """Columns `(m, c, k)` of the smooth model of these channels.

    All single variables, states with a memory, and the pairs that explain most of a residual.

    Parameters
    ----------
    inputs : sequence of Covariates
        Variables of each channel.
    tests : sequence of sequences of Cells
        Of each channel; its pairs are those that may be chosen.
    channels : (c,) bool array
        Which channels the model speaks of.
    residual : (m, c) array
        By which the pairs are chosen.
    rows : (m,) bool array
        On which they are chosen.
    """
    m, c = residual.shape
    parts: list[FloatArray] = []
    for i in map(int, np.flatnonzero(channels)):
        pairs = [t for t in tests[i] if len(t.variables) == 2]
        strength = [_explained(t, residual[:, i], rows) for t in pairs]
        chosen = [pairs[k].variables for k in np.argsort(strength)[::-1][: NAMING.smooth_pairs]]
        for variables in (*((name,) for name in inputs[i].values), *chosen):
            basis = _basis([inputs[i].values[v] for v in variables])
            parts.append(_in_channel(basis, i, c))
        if inputs[i].memory:
            states = np.stack(inputs[i].memory, axis=1)
            parts.append(_in_channel(states / states.std(axis=0), i, c))
    return np.concatenate(parts, axis=2) if parts else np.zeros((m, c, 0))


def _in_channel(basis: FloatArray, channel: int, n_channels: int) -> FloatArray:
    columns = np.zeros((len(basis), n_channels, basis.shape[1]))
    columns[:, channel] = basis
    return columns


def _basis(values: Sequence[FloatArray]) -> FloatArray:
    """Hat functions of one variable, or their products for two `(m, k)`."""
    hats = [_hats(v, KNOTS[len(values)]) for v in values]
    if len(hats) == 1:
        return hats[0]
    product: FloatArray = (hats[0][:, :, None] * hats[1][:, None, :]).reshape(len(hats[0]), -1)
    return product


def _hats(values: FloatArray, n_knots: int) -> FloatArray:
    """Piecewise linear functions `(m, k)`, each one at one quantile and zero at the others.

    Few values have one each.
    """
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


def smooth_fit(
    discovery: DatasetWhitener,
    z: tuple[FloatArray, FloatArray],
    slopes: tuple[FloatArray, FloatArray],
    white: tuple[FloatArray, FloatArray],
    size: float,
) -> SmoothFit:
    """Fit the smooth model beside a set's tangents, which take up what they can.

    What is left to it is orthogonal to them.

    Parameters
    ----------
    discovery : DatasetWhitener
        How that part is seen.
    z : pair of arrays
        Whitened residual of the set on each part.
    slopes : pair of arrays
        Whitened tangents of the set.
    white : pair of (M, k) arrays
        Whitened columns of the smooth model on each part.
    size : float
        Root mean square of the residual: scale of a column's size.
    """
    k = white[0].shape[1]
    if k == 0:
        return SmoothFit(0.0, 0.0)
    seen = np.concatenate([slopes[0], white[0]], axis=1)
    sums = discovery.grams(seen, z[0])
    p = slopes[0].shape[1]
    fold = fold_of(len(sums.gram))
    own = held_out_nats(sums.take(list(range(p))), fold).sum() if p else 0.0
    best, precision = -np.inf, np.zeros(0)
    for strength in PRECISIONS:
        prior = np.r_[np.zeros(p), np.full(k, strength / size**2)]
        nats = float(held_out_nats(sums, fold, prior).sum())
        if nats > best:
            best, precision = nats, prior
    beta = solve(sums.gram.sum(axis=0) + np.diag(precision), sums.moment.sum(axis=0))
    shift = np.concatenate([slopes[1], white[1]], axis=1) @ beta
    gram, moment = sums.gram.sum(axis=0), sums.moment.sum(axis=0)
    own_shift = slopes[1] @ solve(gram[:p, :p], moment[:p]) if p else np.zeros(len(z[1]))
    gain = 0.5 * (((z[1] - own_shift) ** 2).sum() - ((z[1] - shift) ** 2).sum())
    return SmoothFit(best - float(own), float(gain))
