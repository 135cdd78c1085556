"""What no effect of the catalogue says: a smooth model of the residual, additive in all variables plus its strongest pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.cells import Cells, indicator
from gpcorrect.discrepancy.evidence import fold_of, held_out_nats, solve
from gpcorrect.discrepancy.lens import Lens
from gpcorrect.discrepancy.trial import FOLDS
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["SmoothFit", "smooth_columns", "smooth_fit"]

PAIRS = 3  # strongest of a channel
PRECISIONS = (1.0, 10.0, 100.0)  # of a cell's mean, in units of the residual's mean square


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
    cells_of_channel: Sequence[Sequence[Cells]], channels: BoolArray, residual: FloatArray, rows: BoolArray
) -> FloatArray:
    """Columns `(m, c, k)` of the smooth model of these channels: all single variables, and the pairs that explain most of a residual.

    Parameters
    ----------
    cells_of_channel : sequence of sequences of Cells
        Tests of each channel.
    channels : (c,) bool array
        Which channels the model speaks of.
    residual : (m, c) array
        By which the pairs are chosen.
    rows : (m,) bool array
        On which they are chosen.
    """
    m, c = residual.shape
    parts: list[FloatArray] = []
    every_row = np.arange(m)
    for i in np.flatnonzero(channels):
        single = [t for t in cells_of_channel[i] if len(t.variables) == 1]
        pairs = [t for t in cells_of_channel[i] if len(t.variables) == 2]
        strength = [_explained(t, residual[:, i], rows) for t in pairs]
        chosen = [pairs[k] for k in np.argsort(strength)[::-1][:PAIRS]]
        for cells in (*single, *chosen):
            columns = np.zeros((m, c, len(cells.words)))
            columns[:, i] = indicator(cells, every_row)
            parts.append(columns)
    return np.concatenate(parts, axis=2) if parts else np.zeros((m, c, 0))


def _explained(cells: Cells, residual: FloatArray, rows: BoolArray) -> float:
    """Variance between cells over variance, on finite rows."""
    good = rows & np.isfinite(residual)
    code, value = cells.code[good], residual[good]
    count = np.bincount(code)
    mean = np.bincount(code, value) / np.maximum(count, 1)
    return float((count * (mean - value.mean()) ** 2).sum() / max(((value - value.mean()) ** 2).sum(), 1e-300))


def smooth_fit(
    discovery: Lens,
    confirmation: Lens,
    z: tuple[FloatArray, FloatArray],
    slopes: tuple[FloatArray, FloatArray],
    columns: FloatArray,
    size: float,
) -> SmoothFit:
    """Fit the smooth model beside a set's tangents, which take up what they can: what is left to it is orthogonal to them.

    Parameters
    ----------
    discovery, confirmation : Lens
        How the two parts are seen.
    z : pair of arrays
        Seen residual of the set on each part.
    slopes : pair of arrays
        Seen tangents of the set.
    columns : (m, c, k) array
        Of the smooth model.
    size : float
        Root mean square of the residual: scale of a cell's mean.
    """
    if columns.shape[2] == 0:
        return SmoothFit(0.0, 0.0)
    seen = np.concatenate([slopes[0], discovery.look(columns)], axis=1)
    sums = discovery.grams(seen, z[0])
    p = slopes[0].shape[1]
    fold = fold_of(len(sums.gram), FOLDS)
    own = held_out_nats(sums.take(list(range(p))), fold).sum() if p else 0.0
    best, precision = -np.inf, np.zeros(0)
    for strength in PRECISIONS:
        prior = np.r_[np.zeros(p), np.full(columns.shape[2], strength / size**2)]
        nats = float(held_out_nats(sums, fold, prior).sum())
        if nats > best:
            best, precision = nats, prior
    beta = solve(sums.gram.sum(axis=0) + np.diag(precision), sums.moment.sum(axis=0))
    other = np.concatenate([slopes[1], confirmation.look(columns)], axis=1)
    shift = other @ beta
    own_shift = slopes[1] @ _own(sums.gram.sum(axis=0), sums.moment.sum(axis=0), p)
    gain = 0.5 * (((z[1] - own_shift) ** 2).sum() - ((z[1] - shift) ** 2).sum())
    return SmoothFit(best - float(own), float(gain))


def _own(gram: FloatArray, moment: FloatArray, p: int) -> FloatArray:
    return solve(gram[:p, :p], moment[:p]) if p else np.zeros(0)
