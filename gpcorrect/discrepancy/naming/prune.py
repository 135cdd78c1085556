"""From a finished search to names.

What cannot be named is taken out, one at a time, and the rest weighed again without it. It may have stood in for
something else: beside what stays, that is looked for anew, and at once where its numbers were not physical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpcorrect.discrepancy.evidence.cells import Cells
from gpcorrect.discrepancy.naming.name import name_member
from gpcorrect.discrepancy.naming.named import Named
from gpcorrect.discrepancy.naming.posterior import SHAPE_ERROR
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
AGAIN = 2  # searches for what the effects taken out had stood in for
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
    opinions: dict[int, Opinion] = {}
    dropped: list[Named] = []
    swaps = again = looked = 0
    total = len(search.members)
    while search.members:
        view = view_of(search, tests, inputs)
        opinions = {id(m): opinions.get(id(m)) or name_member(view, m) for m in search.members}
        better = _better_rival(search, opinions, dropped) if swaps < SWAPS else None
        if better is not None:
            swaps += 1
            search, opinions = _changed(search, better, opinions)
            continue
        weakest = _weakest(search, opinions)
        if weakest is not None:
            dropped.append(opinions[id(weakest)][0])
            rest = search.refit([m for m in search.members if m is not weakest], weakest.candidate)
            search, opinions = _changed(search, rest, opinions)
            if progress is not None:
                progress.step("naming", len(dropped) / (total + len(dropped)))
            if not weakest.at_edge:
                continue
        gone, looked = dropped[looked:], len(dropped)
        if again == AGAIN or not any(n.member.at_edge or n.nats > STRONG for n in gone):
            if weakest is None:
                break
            continue
        again += 1
        fresh = search_on(search, rounds=ROUNDS, refused=[n.member.candidate for n in dropped])
        if fresh is not search:
            search, opinions, swaps = fresh, {}, 0
    if progress is not None:
        progress.step("naming", 1.0)
    return search, tuple(opinions[id(m)][0] for m in search.members), tuple(dropped)


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


def _changed(
    search: Search, members: Sequence[Member], opinions: dict[int, Opinion]
) -> tuple[Search, dict[int, Opinion]]:
    """Return the search with another set, and the opinions on members that no change can have touched."""
    now = {id(m) for m in members}
    moved = [m for m in search.members if id(m) not in now]
    fresh = replace(search, members=tuple(members))
    kept = {
        id(m): opinions[id(m)]
        for m in members
        if id(m) in opinions and not any(search.alike(m.candidate, gone.candidate) for gone in moved)
    }
    return fresh, kept
