"""From a finished search to names.

What cannot be named is taken out, one at a time, and the rest weighed again without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gpcorrect.discrepancy.evidence.cells import Cells
from gpcorrect.discrepancy.naming.name import name_member
from gpcorrect.discrepancy.naming.named import Named
from gpcorrect.discrepancy.naming.weigh import Weighed, view_of
from gpcorrect.discrepancy.recording.covariates import Covariates
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.state import COMPLEXITY, Search
from gpcorrect.types import Progress

__all__ = ["name_members"]

Opinion = tuple[Named, Weighed]
SWAPS = 6  # at most


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
    total, swaps = len(search.members), 0
    while search.members:
        view = view_of(search, tests, inputs)
        opinions = {id(m): opinions.get(id(m)) or name_member(view, m) for m in search.members}
        better = _better_rival(search, opinions) if swaps < SWAPS else None
        if better is not None:
            swaps += 1
            search, opinions = _changed(search, better, opinions)
            continue
        weakest = _weakest(search, opinions)
        if weakest is None:
            break
        dropped.append(opinions[id(weakest)][0])
        rest = search.refit([m for m in search.members if m is not weakest], weakest.candidate)
        search, opinions = _changed(search, rest, opinions)
        if progress is not None:
            progress.step("naming", len(dropped) / (total + 1))
    if progress is not None:
        progress.step("naming", 1.0)
    return search, tuple(opinions[id(m)][0] for m in search.members), tuple(dropped)


def _better_rival(search: Search, opinions: dict[int, Opinion]) -> tuple[Member, ...] | None:
    """Return the set with the rival that gains most beyond the member whose place it takes.

    None when no rival gains.
    """
    best, place, new = 0.0, None, None
    for member in search.members:
        _, weighed = opinions[id(member)]
        for rival in weighed.rivals:
            gain = (rival.nats - weighed.nats) / weighed.temper
            gain -= COMPLEXITY * (rival.candidate.extra - member.candidate.extra)
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
