"""Effects of which another one is a special case, and what their evidence is beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.linearisation import linearise
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import FloatArray


def more_general(
    search: Search, rest: Sequence[FittedEffect], fit: FittedEffect, noisier: float
) -> list[tuple[FittedEffect, float]]:
    """Return look-alikes in the catalogue of which an effect is a special case, with their nats beyond the effect's.

    An error of the first row of a kinematic table is an error of the registration. No data rule such a one out, unless
    they would show its further numbers, were those as large as the ones that are seen. So both are weighed by their
    evidence as linear models (Bishop 2006, Eq. 3.86) whose numbers have a normal prior of one size, in units of what is
    typical of each: that of the effect's own numbers. Effects that do not grow with every number are no such models.

    Parameters
    ----------
    search : Search
    rest : sequence of FittedEffect
        The set without the effect.
    fit : FittedEffect
    noisier : float
        By how much evidence counts less.
    """
    if not _is_linear(fit.candidate):
        return []
    alike = fit.candidate.kind.about.neighbours
    own = _Linear.of(search, rest, fit)
    change = own.slopes @ fit.u
    found: dict[tuple[object, ...], tuple[FittedEffect, float]] = {}
    for trace in search.traces:
        other = trace.candidate
        wider = other.extra > fit.candidate.extra and other.name in alike and _is_linear(other)
        if not wider or other.key in found or any(other.key == m.candidate.key for m in rest):
            continue
        columns = search.whitener.whiten_columns(trace.change)
        factors = _factors(columns, change)
        left = change - columns @ factors
        if left @ left > NAMING.general * (change @ change):
            continue
        fitted = search.refit((*rest, FittedEffect(other, other.scaled(factors))), other)
        if not fitted[-1].at_edge:
            wide = _Linear.of(search, rest, fitted[-1])
            nats = noisier * (wide.evidence(change, noisier) - own.evidence(change, noisier))
            found[other.key] = fitted[-1], nats
    return list(found.values())


@dataclass(frozen=True, eq=False)
class _Linear:
    """Whitened tangents `(M, p)` of an effect and the residual `(M,)` without it, less what others can take up."""

    slopes: FloatArray
    z: FloatArray

    @classmethod
    def of(cls, search: Search, rest: Sequence[FittedEffect], fit: FittedEffect) -> _Linear:
        at = linearise(search.whitener, [fit], rest)
        others = search.linearise_near(rest, fit.candidate).slopes
        basis = np.linalg.qr(others)[0] if others.shape[1] else others
        own = np.column_stack([at.slopes, at.z + at.slopes @ fit.u])
        own -= basis @ (basis.T @ own)
        return cls(own[:, :-1], own[:, -1])

    def evidence(self, change: FloatArray, noisier: float) -> float:
        """Log evidence with a normal prior of its numbers, of the mean square that their part in a change has."""
        size = float(np.mean(_factors(self.slopes, change) ** 2))
        precision = self.slopes.T @ self.slopes / noisier + np.eye(self.slopes.shape[1]) / size
        moment = self.slopes.T @ self.z / noisier
        return 0.5 * float(moment @ np.linalg.solve(precision, moment) - np.linalg.slogdet(size * precision)[1])


def _is_linear(candidate: Candidate) -> bool:
    return all(c.amplitude and c.identity == 0.0 for c in candidate.coordinates)


def _factors(columns: FloatArray, change: FloatArray) -> FloatArray:
    return solve(columns.T @ columns, columns.T @ change)
