"""Instants at which something happens: found by looking at every row, since no slope leads to them.

For a change-point t, all else held, `y = a s_t + e`: the gain is `(s_t' z)^2 / (2 s_t' s_t)`, and its profile over t is
as good as the likelihood's (Hinkley 1970, Biometrika 57(1)). Under slow noise it is spiky: the jump itself tells most,
and shows in one row. What follows an instant does not depend on it, so that one trace, cut at each row, gives them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.types import BoolArray, FloatArray

POINTS = 17  # instants in a row at which the gain is computed
COARSE, NEAR = 8, 200  # rows: of a first look, and on either side of the best of it
AT_ONCE = 128  # traces, for memory's sake


def with_best_instant(whitener: DatasetWhitener, others: Sequence[FittedEffect], fit: FittedEffect) -> FittedEffect:
    """Move an effect's change-point, and its size with it, to where they explain most.

    Parameters
    ----------
    whitener : DatasetWhitener
    others : sequence of FittedEffect, present beside it
    fit : FittedEffect
    """
    fit = _scanned(whitener, others, fit)
    index, dataset, effects = _place(fit), whitener.dataset, [f.effect for f in others]
    coordinate, window = fit.candidate.coordinates[index], _row_seconds(dataset)
    base = dataset.predict(effects)
    z = whitener.whiten(dataset.observed - base)
    instants = coordinate.value(float(fit.u[index])) + np.linspace(-window, window, POINTS)
    u = np.unique(np.clip([coordinate.coordinate(t) for t in instants if t > 0.0], *coordinate.bounds))
    factor, nats = np.zeros(len(u)), np.zeros(len(u))
    for i, x in enumerate(u):
        white = whitener.whiten(dataset.predict([*effects, fit.moved(index, x).effect]) - base)
        energy = float(white @ white)
        if energy > 0.0:
            factor[i] = float(white @ z) / energy
            nats[i] = 0.5 * factor[i] ** 2 * energy
    best = int(np.argmax(nats)) if len(u) else None
    return fit if best is None else _resized(fit, float(u[best]), float(factor[best]))


def with_open_instant_placed(
    open_to: DatasetWhitener, others: Sequence[FittedEffect], fit: FittedEffect, known: BoolArray
) -> tuple[FittedEffect, int]:
    """Move a change-point between two known rows to where it explains other rows there best; its size stays.

    An instant in a pause of the discovery part is open to its ends, and the confirmation part may lie between them.
    Also return among how many it was chosen: the mean of their likelihoods is the best one's divided by that, at least.

    Parameters
    ----------
    open_to : DatasetWhitener, of the rows that may decide
    others : sequence of FittedEffect, present beside it
    fit : FittedEffect
    known : (m,) bool array, rows that it was fitted on
    """
    index, cuts = _place(fit), _cuts(open_to, others, fit)
    coordinate = fit.candidate.coordinates[index]
    at, clock = coordinate.value(float(fit.u[index])), cuts.clock[known & cuts.trace.any(axis=1)]
    before, after = clock[clock < at].max(initial=-np.inf), clock[clock >= at].min(initial=np.inf)
    tried = cuts.instants[(cuts.instants > before) & (cuts.instants <= after)]
    if len(tried) < 2:
        return fit, 1
    nats = cuts.gain(tried)
    if np.ptp(nats) == 0.0:
        return fit, 1
    return fit.moved(index, coordinate.coordinate(float(tried[int(nats.argmax())]))), len(tried)


def _resized(fit: FittedEffect, u_instant: float, factor: float) -> FittedEffect:
    """Return an effect with its change-point elsewhere, and its sizes multiplied."""
    u = np.array(fit.u)
    u[list(fit.candidate.sizes)] *= factor
    u[_place(fit)] = u_instant
    return replace(fit, u=np.clip(u, *fit.candidate.bounds))


def _scanned(whitener: DatasetWhitener, others: Sequence[FittedEffect], fit: FittedEffect) -> FittedEffect:
    """Move an effect to the best row: first of every few rows, then of all rows near the best of those."""
    cuts = _cuts(whitener, others, fit)
    instants = cuts.instants
    if len(instants) == 0:
        return fit
    for stride in (COARSE, 1):
        tried = instants[::stride]
        factor, nats = cuts.at(tried)
        flat = np.flatnonzero(nats >= nats.max() - 1e-9 * abs(nats.max()))
        best = int(flat[len(flat) // 2])  # where nothing is seen, the middle
        near = np.searchsorted(instants, tried[best])
        instants = instants[max(near - NEAR, 0) : near + NEAR + 1]
    place = int(np.searchsorted(cuts.instants, tried[best]))
    since = max(cuts.instants[max(place - 1, 0)] + _row_seconds(whitener.dataset), cuts.instants[0])
    instant = 0.5 * (since + tried[best]) if since < tried[best] else tried[best]  # in the middle of a pause
    return _resized(fit, fit.candidate.coordinates[_place(fit)].coordinate(float(instant)), float(factor[best]))


@dataclass(frozen=True, eq=False)
class _Cuts:
    """One trace `(m, c)` that can begin at any row, by the rows' clock `(m,)`, and what it has to explain `(M,)`."""

    whitener: DatasetWhitener
    z: FloatArray
    trace: FloatArray
    clock: FloatArray
    instants: FloatArray

    def at(self, instants: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the best factor of the trace when it begins at each instant `(k,)`, s, and its gain in nats."""
        energy, along = self._products(instants)
        factor = np.divide(along, energy, out=np.zeros(len(instants)), where=energy > 0.0)
        return factor, 0.5 * factor * along

    def gain(self, instants: FloatArray) -> FloatArray:
        """Return the gain in nats of the trace as it is when it begins at each instant `(k,)`, s."""
        energy, along = self._products(instants)
        return along - 0.5 * energy

    def _products(self, instants: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of each whitened cut with itself, and with what is to be explained."""
        energy, along = np.zeros(len(instants)), np.zeros(len(instants))
        for begin in range(0, len(instants), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            white = self.whitener.whiten_columns(
                self.trace[:, :, None] * (self.clock[:, None] >= instants[part])[:, None, :]
            )
            energy[part], along[part] = (white**2).sum(axis=0), white.T @ self.z
        return energy, along


def _cuts(whitener: DatasetWhitener, others: Sequence[FittedEffect], fit: FittedEffect) -> _Cuts:
    """Trace of an effect from the earliest instant on, and the instants just before each row at which it may begin."""
    dataset, coordinate = whitener.dataset, fit.candidate.coordinates[_place(fit)]
    first, last = (coordinate.value(u) for u in coordinate.bounds)
    clock = dataset.means(dataset.scene.layout.gather(dataset.scene.motion.time))
    base = dataset.predict([f.effect for f in others])
    earliest = _resized(fit, coordinate.bounds[0], 1.0)
    trace = dataset.predict([*(f.effect for f in others), earliest.effect]) - base
    if (session := dict(fit.candidate.fixed).get("session")) is not None:  # a registered tracker shows it in others too
        trace[dataset.means((dataset.scene.session != session).astype(np.float64)) > 0.0] = 0.0
    rows = (clock >= first) & (clock <= last) & trace.any(axis=1)
    instants = np.clip(np.unique(clock[rows]) - 0.5 * _row_seconds(dataset), first, last)
    return _Cuts(whitener, whitener.whiten(dataset.observed - base), trace, clock, instants)


def _row_seconds(dataset: Dataset) -> float:
    return float(np.median(np.diff(dataset.time)[np.diff(dataset.block) == 0]))


def instant_half_width(whitener: DatasetWhitener, others: Sequence[FittedEffect], fit: FittedEffect) -> float:
    """Return the half width of the 95 % interval of a change-point's coordinate.

    At every row, for the profile has many tops; and a row more, within which nothing can be distinguished.

    Parameters
    ----------
    whitener : DatasetWhitener
    others : sequence of FittedEffect, present beside it
    fit : FittedEffect
    """
    index = _place(fit)
    coordinate, cuts = fit.candidate.coordinates[index], _cuts(whitener, others, fit)
    at = coordinate.value(float(fit.u[index]))
    tried = np.sort(np.append(cuts.instants, at))
    _, nats = cuts.at(tried)
    inside = np.flatnonzero(nats > nats.max() - 0.5 * chi2.ppf(0.95, 1))
    first, last = tried[max(inside.min() - 1, 0)], tried[inside.max()]  # an instant is anywhere since the row before it
    half = float(max(at - first, last - at)) + _row_seconds(whitener.dataset)
    ends = [coordinate.coordinate(max(t, 1e-9)) for t in (at - half, at + half)]
    return float(np.abs(np.array(ends) - fit.u[index]).max())


def _place(fit: FittedEffect) -> int:
    assert fit.candidate.instant is not None
    return fit.candidate.instant
