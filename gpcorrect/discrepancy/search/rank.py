"""A first look at every candidate: its linear held-out gain beyond a set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.discrepancy.evidence.linear import bordered, fold_of, held_out_nats, solve
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.state import COMPLEXITY, Search
from gpcorrect.discrepancy.search.trial import FOLDS, Trial
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Ranked", "rank"]


@dataclass(frozen=True, eq=False)
class Ranked:
    """A candidate's linear gain beyond a set, and the factors of its amplitudes."""

    candidate: Candidate
    nats: float
    factors: FloatArray = field(default_factory=lambda: np.ones(1))

    @property
    def member(self) -> Member:
        """The candidate at its first estimate."""
        return Member(self.candidate, self.candidate.scaled(self.factors))


def rank(
    search: Search, trial: Trial, without: Sequence[Candidate] = (), channels: BoolArray | None = None
) -> list[Ranked]:
    """Linear held-out gain of every candidate beyond a set, the best variant of each, largest first.

    Parameters
    ----------
    search : Search
        Data and signatures.
    trial : Trial
        The set, whose free numbers move along with the candidate's.
    without : sequence of Candidate
        Not to be looked at, whatever their numbers.
    channels : (c,) bool array, optional
        Only candidates that show in one of these.
    """
    taken = {m.candidate.key for m in trial.members} | {c.key for c in without}
    lens = search.lens
    base = lens.grams(trial.slopes, trial.z)
    p = trial.slopes.shape[1]
    fold = fold_of(int(lens.block.max()) + 1, FOLDS)
    base_nats = float(held_out_nats(base, fold).sum()) if p else 0.0
    best: dict[tuple[object, ...], Ranked] = {}
    for trace in search.traces:
        candidate = trace.candidate
        if candidate.key in taken or (channels is not None and not (trace.touched & channels).any()):
            continue
        sums = bordered(base, trial.slopes, lens.look(trace.change), trial.z, lens.block)
        factors = solve(sums.gram.sum(axis=0), sums.moment.sum(axis=0))[p:]
        if not _is_physical(candidate, factors):
            continue
        nats = float(held_out_nats(sums, fold).sum()) - base_nats - COMPLEXITY * candidate.extra
        if candidate.key not in best or nats > best[candidate.key].nats:
            best[candidate.key] = Ranked(candidate, nats, factors)
    return sorted(best.values(), key=lambda r: -r.nats)


def _is_physical(candidate: Candidate, factors: FloatArray) -> bool:
    """Whether amplitudes that cannot be negative are not, nor the whole of an effect that has none."""
    if not candidate.amplitudes:
        return bool((factors > 0).all())
    one_sided = [candidate.coordinates[i] for i in candidate.amplitudes]
    return all(f > 0 for c, f in zip(one_sided, factors, strict=True) if c.parameter.positive or c.kind == "inverse")
