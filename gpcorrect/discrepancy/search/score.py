"""Which effects explain the discrepancy.

Forward steps by held-out nats, refinement before the next step, backward deletion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.rank import rank
from gpcorrect.discrepancy.search.state import Search, Step, penalty
from gpcorrect.discrepancy.search.trial import Trial, held_out
from gpcorrect.types import BoolArray, Progress

__all__ = ["Search", "Step", "contribution", "search"]

ROUNDS = 4  # at most one effect a joint in each
REFINED = 2  # leaders that are refined before one is chosen
LOOKED_AT = 4  # for that many whose numbers stay physical
NEAR_LEADER = 0.3  # of the leader's nats: below, a candidate is not worth refining


def search(
    state: Search, *, rounds: int = ROUNDS, refused: Sequence[Candidate] = (), progress: Progress | None = None
) -> Search:
    """Add effects while they pay, at most one a joint in each round, and take out those that no longer do.

    Parameters
    ----------
    state : Search
        Where to start.
    rounds : int
        At most.
    refused : sequence of Candidate
        Not to be added.
    progress : Progress, optional
        Told of each round.

    Returns
    -------
    Search
        With the members found.
    """
    refused = list(refused)
    for number in range(rounds):
        threshold = penalty(state.n_kinds, number)
        joints: set[int | str] = set()
        grown = state
        while (grown := _forward(state, threshold, joints, refused)) is not state:
            state = grown
        if progress is not None:
            progress.step("search", (number + 1) / rounds)
        if not joints:
            break
        state = _physical(_merged(state, threshold), refused)
        state = _backward(state, threshold).refreshed()
    if progress is not None:
        progress.step("search", 1.0)
    return state


def _forward(state: Search, threshold: float, joints: set[int | str], refused: Sequence[Candidate]) -> Search:
    """Add the best of the refined leaders on a joint that is still open in this round.

    The same state when none pays.
    """
    trial = state.whole_trial()
    ranked = [r for r in rank(state, trial, refused) if r.candidate.joint not in joints and r.nats > 0]
    leaders = [
        r for r in ranked if r.nats > NEAR_LEADER * ranked[0].nats and state.alike(r.candidate, ranked[0].candidate)
    ]
    best: tuple[float, tuple[Member, ...]] | None = None
    refined = 0
    for leader in leaders[:LOOKED_AT]:
        members = state.refit((*state.members, leader.member), leader.candidate)
        if members[-1].at_edge:
            continue
        refined += 1
        gain = gain_over(state, trial, members, leader.member)
        if best is None or gain > best[0]:
            best = gain, members
        if refined == REFINED:
            break
    if best is None or best[0] < threshold:
        return state
    new = best[1][-1].candidate
    joints.add(new.joint)
    steps = (*state.waterfall, Step(new.label, best[0]))
    return replace(state, members=best[1], waterfall=steps).refreshed()


def gain_over(
    state: Search, before: Trial, members: Sequence[Member], new: Member, channels: BoolArray | None = None
) -> float:
    """Held-out nats of a set beyond another one's, tempered by how far the new residual still is from noise.

    In these channels; by default in those in which the new member shows.
    """
    after = state.trial(members, new.candidate)
    nats = held_out(state.lens, before.z, after.z, after.slopes) - held_out(
        state.lens, before.z, before.z, state.trial(before.members, new.candidate).slopes
    )
    return float(nats.sum()) / state.tempering(after.z, state.touched(new.candidate) if channels is None else channels)


def _merged(state: Search, threshold: float) -> Search:
    """Put one effect in the place of two on one joint where it explains as much: two off-grid guesses of one thing."""
    for a, b in combinations(state.members, 2):
        if a.candidate.joint != b.candidate.joint:
            continue
        rest = tuple(m for m in state.members if m is not a and m is not b)
        bare = state.trial(rest, a.candidate)
        both = state.touched(a.candidate) & state.touched(b.candidate)
        pair = gain_over(state, bare, state.members, b, both)
        ranked = rank(state, bare, [a.candidate, b.candidate], state.touched(a.candidate))[:1]
        for leader in ranked:
            if leader.nats < 0.8 * pair:
                continue
            members = state.refit((*rest, leader.member), leader.candidate)
            one = gain_over(state, bare, members, leader.member, both)
            if not members[-1].at_edge and one > pair - threshold:
                label = f"{leader.candidate.label} for {a.candidate.label} and {b.candidate.label}"
                steps = (*state.waterfall, Step(label, leader.nats - pair))
                return replace(state, members=members, waterfall=steps).refreshed()
    return state


def _physical(state: Search, refused: list[Candidate]) -> Search:
    """Take out members whose numbers have left for the edge of their range as others came; they do not come again."""
    while edgy := [m for m in state.members if m.at_edge]:
        gone = edgy[-1]
        refused.append(gone.candidate)
        rest = state.refit([m for m in state.members if m is not gone], gone.candidate)
        steps = (*state.waterfall, Step(f"without {gone.candidate.label}, not physical", 0.0))
        state = replace(state, members=rest, waterfall=steps)
    return state


def _backward(state: Search, threshold: float) -> Search:
    """Take out members that the others make superfluous, the least useful first."""
    while len(state.members) > 1:
        worth = [contribution(state, i) for i in range(len(state.members))]
        least = int(np.argmin(worth))
        if worth[least] >= threshold:
            break
        gone = state.members[least]
        rest = state.refit([m for m in state.members if m is not gone], gone.candidate)
        steps = (*state.waterfall, Step(f"without {gone.candidate.label}", -worth[least]))
        state = replace(state, members=rest, waterfall=steps)
    return state


def contribution(state: Search, index: int) -> float:
    """Held-out nats that the set loses without one member, the others refitted to first order."""
    member = state.members[index]
    rest = [m for m in state.members if m is not member]
    return gain_over(state, state.trial(rest, member.candidate), state.members, member)
