"""From a finished search to names.

What cannot be named is taken out, one at a time, and the rest weighed again without it. It may have stood in for
something else: beside what stays, that is looked for anew, and at once where its numbers were not physical.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.discrepancy.evidence.variables import Cells, Covariates
from gpcorrect.discrepancy.naming.posterior import Named, name_effect
from gpcorrect.discrepancy.naming.weigh import Weighed, view_of
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.search.stepwise import search as search_on
from gpcorrect.discrepancy.settings import NAMING, SEARCH
from gpcorrect.types import Progress

__all__ = ["name_effects"]

Assessment = tuple[Named, Weighed]
TINY = 1e-12  # odds


def name_effects(
    search: Search,
    tests: Sequence[Sequence[Cells]],
    inputs: Sequence[Covariates],
    *,
    progress: Progress | None = None,
) -> tuple[Search, tuple[Named, ...], tuple[Named, ...]]:
    """Weigh every fit of a finished search; put better rivals in place, and take out what may not be named.

    An effect is weighed anew whenever an effect that shows in its channels has gone or changed.

    Parameters
    ----------
    search : Search
        Finished.
    tests, inputs : sequences
        Of each channel, for the unknown.
    progress : Progress, optional
        Reported each pass.

    Returns
    -------
    search : Search
        With the named effects only.
    named : tuple of Named
        Those, in the same order.
    dropped : tuple of Named
        The others, with the reasons.
    """
    selection = _ModelSelection(search, tests, inputs)
    total = len(search.fitted)
    while selection.step():
        if progress is not None:
            progress.step("naming", len(selection.dropped) / (total + len(selection.dropped) + 1))
    if progress is not None:
        progress.step("naming", 1.0)
    named = tuple(selection.assessments[id(m)][0] for m in selection.search.fitted)
    return selection.search, named, tuple(selection.dropped)


@dataclass
class _ModelSelection:
    """A set of effects on its way to names; every step changes it once.

    Parameters
    ----------
    search : Search
        With the effects as they are now.
    tests, inputs : sequences
        Of each channel, for the unknown.
    assessments : dict
        On each fit, by its identity.
    dropped : list of Named
        Taken out so far.
    swaps : int
        Rivals put in place since the last search.
    searches : Counter
        Searches made for what was taken out at each joint: one joint may not use up another's.
    filled : int
        How many of the dropped the last search has looked for a replacement of.
    """

    search: Search
    tests: Sequence[Sequence[Cells]]
    inputs: Sequence[Covariates]
    assessments: dict[int, Assessment] = field(default_factory=dict)
    dropped: list[Named] = field(default_factory=list)
    swaps: int = 0
    searches: Counter[int | str] = field(default_factory=Counter)
    filled: int = 0

    def step(self) -> bool:
        """Change the set once; False when there is nothing to change, or nothing left to name."""
        if not self.search.fitted:
            return False
        view = view_of(self.search, self.tests, self.inputs)
        self.assessments = {id(m): self.assessments.get(id(m)) or name_effect(view, m) for m in self.search.fitted}
        return self._swap() or self._drop() or self._search_again()

    def _swap(self) -> bool:
        """Put the best rival in an effect's place."""
        if self.swaps == NAMING.swaps:
            return False
        better = _better_rival(self.search, self.assessments, self.dropped)
        if better is None:
            return False
        self.swaps += 1
        self._change(better)
        return True

    def _drop(self) -> bool:
        """Take the weakest of those out that may not be named; what stood in for something unphysical is sought now."""
        poor = [m for m in self.search.fitted if not self.assessments[id(m)][0].may_be_named]
        if not poor:
            return False
        weakest = min(poor, key=lambda m: self.assessments[id(m)][0].nats)
        self.dropped.append(self.assessments[id(weakest)][0])
        self._change(self.search.refit([m for m in self.search.fitted if m is not weakest], weakest.candidate))
        if weakest.at_edge:
            self._search_again()
        return True

    def _search_again(self) -> bool:
        """Look for what the effects taken out since the last search had stood in for, if they leave a hole."""
        gone, self.filled = self.dropped[self.filled :], len(self.dropped)
        holes = {n.fit.candidate.joint for n in gone if n.fit.at_edge or n.nats > NAMING.hole}
        if all(self.searches[joint] >= NAMING.searches for joint in holes):
            return False
        self.searches.update(holes)
        found = search_on(self.search, rounds=NAMING.search_rounds, refused=[n.fit.candidate for n in self.dropped])
        found_more = found is not self.search
        if found_more:
            self.search, self.assessments, self.swaps = found, {}, 0
        return found_more

    def _change(self, fitted: Sequence[FittedEffect]) -> None:
        """Go on with another set; assessments stay on fitted that no change can have touched."""
        now = {id(m) for m in fitted}
        moved = [m for m in self.search.fitted if id(m) not in now]
        self.assessments = {
            id(m): self.assessments[id(m)]
            for m in fitted
            if id(m) in self.assessments and not any(self.search.alike(m.candidate, gone.candidate) for gone in moved)
        }
        self.search = replace(self.search, fitted=tuple(fitted))


def _better_rival(
    search: Search, assessments: dict[int, Assessment], dropped: Sequence[Named]
) -> tuple[FittedEffect, ...] | None:
    """Return the set with a rival in the place of the fit beyond which it gains most.

    None when no rival gains: explains more, or as much and is more probable. Those that were dropped stay out.
    """
    best, place, new = 0.0, None, None
    out = {n.fit.candidate.key for n in dropped}
    for fit in search.fitted:
        named, weighed = assessments[id(fit)]
        odds = {a.label: a.probability / max(named.probability, TINY) for a in named.alternatives}
        for rival in (r for r in weighed.rivals if r.candidate.key not in out):
            gain = (rival.nats - weighed.nats) / weighed.overdispersion
            gain -= 0.0 if rival.is_general else SEARCH.complexity * (rival.candidate.extra - fit.candidate.extra)
            if weighed.nats - rival.nats < NAMING.shape_error**2 * weighed.nats:
                gain = max(gain, float(np.log(odds.get(rival.candidate.label, 0.0) + TINY)))
            if gain > best:
                best, place, new = gain, fit, rival.fit
    if new is None:
        return None
    return search.refit((*(m for m in search.fitted if m is not place), new), new.candidate)
