"""From a finished search to names.

What cannot be named is taken out, one at a time, and the rest weighed again without it. It may have stood in for
something else: beside what stays, that is looked for anew, and at once where its numbers were not physical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.discrepancy.evidence.cells import Cells
from gpcorrect.discrepancy.naming.intervals import SHAPE_ERROR
from gpcorrect.discrepancy.naming.name import name_member
from gpcorrect.discrepancy.naming.named import Named
from gpcorrect.discrepancy.naming.weigh import Weighed, view_of
from gpcorrect.discrepancy.recording.covariates import Covariates
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.score import search as search_on
from gpcorrect.discrepancy.search.state import COMPLEXITY, Search
from gpcorrect.types import Progress

__all__ = ["name_members"]

Opinion = tuple[Named, Weighed]
SWAPS = 6  # at most
TINY = 1e-12  # odds
SEARCHES = 2  # searches for what the effects taken out had stood in for
ROUNDS = 2  # of each
STRONG = 30.0  # nats of an effect that leaves a hole when it goes


def name_members(
    search: Search,
    tests: Sequence[Sequence[Cells]],
    inputs: Sequence[Covariates],
    *,
    progress: Progress | None = None,
) -> tuple[Search, tuple[Named, ...], tuple[Named, ...]]:
    """Weigh every member of a finished search; put better rivals in place, and take out what may not be named.

    An effect is weighed anew whenever a member that shows in its channels has gone or changed.

    Parameters
    ----------
    search : Search
        Finished.
    tests, inputs : sequences
        Of each channel, for the unknown.
    progress : Progress, optional
        Told of each pass.

    Returns
    -------
    search : Search
        With the named members only.
    kept : tuple of Named
        Those, in the same order.
    dropped : tuple of Named
        The others, with the reasons.
    """
    settling = _Settling(search, tests, inputs)
    total = len(search.members)
    while settling.step():
        if progress is not None:
            progress.step("naming", len(settling.dropped) / (total + len(settling.dropped) + 1))
    if progress is not None:
        progress.step("naming", 1.0)
    kept = tuple(settling.opinions[id(m)][0] for m in settling.search.members)
    return settling.search, kept, tuple(settling.dropped)


@dataclass
class _Settling:
    """A set of members on its way to names; every step changes it once.

    Parameters
    ----------
    search : Search
        With the members as they are now.
    tests, inputs : sequences
        Of each channel, for the unknown.
    opinions : dict
        On each member, by its identity.
    dropped : list of Named
        Taken out so far.
    swaps, searches : int
        Rivals put in place since the last search, and searches made.
    filled : int
        How many of the dropped the last search has looked for a replacement of.
    """

    search: Search
    tests: Sequence[Sequence[Cells]]
    inputs: Sequence[Covariates]
    opinions: dict[int, Opinion] = field(default_factory=dict)
    dropped: list[Named] = field(default_factory=list)
    swaps: int = 0
    searches: int = 0
    filled: int = 0

    def step(self) -> bool:
        """Change the set once; False when there is nothing to change, or nothing left to name."""
        if not self.search.members:
            return False
        view = view_of(self.search, self.tests, self.inputs)
        self.opinions = {id(m): self.opinions.get(id(m)) or name_member(view, m) for m in self.search.members}
        return self._swap() or self._drop() or self._search_again()

    def _swap(self) -> bool:
        """Put the best rival in a member's place."""
        if self.swaps == SWAPS:
            return False
        better = _better_rival(self.search, self.opinions, self.dropped)
        if better is None:
            return False
        self.swaps += 1
        self._change(better)
        return True

    def _drop(self) -> bool:
        """Take the weakest of those out that may not be named; what stood in for something unphysical is sought now."""
        weakest = _weakest(self.search, self.opinions)
        if weakest is None:
            return False
        self.dropped.append(self.opinions[id(weakest)][0])
        self._change(self.search.refit([m for m in self.search.members if m is not weakest], weakest.candidate))
        if weakest.at_edge:
            self._search_again()
        return True

    def _search_again(self) -> bool:
        """Look for what the effects taken out since the last search had stood in for, if they leave a hole."""
        gone, self.filled = self.dropped[self.filled :], len(self.dropped)
        if self.searches == SEARCHES or not any(n.member.at_edge or n.nats > STRONG for n in gone):
            return False
        self.searches += 1
        found = search_on(self.search, rounds=ROUNDS, refused=[n.member.candidate for n in self.dropped])
        found_more = found is not self.search
        if found_more:
            self.search, self.opinions, self.swaps = found, {}, 0
        return found_more

    def _change(self, members: Sequence[Member]) -> None:
        """Go on with another set; opinions stay on members that no change can have touched."""
        now = {id(m) for m in members}
        moved = [m for m in self.search.members if id(m) not in now]
        self.opinions = {
            id(m): self.opinions[id(m)]
            for m in members
            if id(m) in self.opinions and not any(self.search.alike(m.candidate, gone.candidate) for gone in moved)
        }
        self.search = replace(self.search, members=tuple(members))


def _better_rival(search: Search, opinions: dict[int, Opinion], dropped: Sequence[Named]) -> tuple[Member, ...] | None:
    """Return the set with a rival in the place of the member beyond which it gains most.

    None when no rival gains: explains more, or as much and is more probable. Those that were dropped stay out.
    """
    best, place, new = 0.0, None, None
    out = {n.member.candidate.key for n in dropped}
    for member in search.members:
        named, weighed = opinions[id(member)]
        odds = {a.label: a.probability / max(named.probability, TINY) for a in named.alternatives}
        for rival in (r for r in weighed.rivals if r.candidate.key not in out):
            gain = (rival.nats - weighed.nats) / weighed.temper
            gain -= COMPLEXITY * (rival.candidate.extra - member.candidate.extra)
            if weighed.nats - rival.nats < SHAPE_ERROR**2 * weighed.nats:
                gain = max(gain, float(np.log(odds.get(rival.candidate.label, 0.0) + TINY)))
            if gain > best:
                best, place, new = gain, member, rival.member
    if new is None:
        return None
    return search.refit((*(m for m in search.members if m is not place), new), new.candidate)


def _weakest(search: Search, opinions: dict[int, Opinion]) -> Member | None:
    """Return the member with the fewest nats among those that may not be named."""
    poor = [m for m in search.members if not opinions[id(m)][0].may_be_named]
    return min(poor, key=lambda m: opinions[id(m)][0].nats) if poor else None
