"""Which effects explain the discrepancy: forward steps by held-out nats, refinement at each, backward deletion."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from gpcorrect.discrepancy.evidence.linear import Beside
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.linearisation import Linearisation, held_out, linearise
from gpcorrect.discrepancy.search.state import Change, Search, Step, penalty
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.parallel import each_here
from gpcorrect.types import BoolArray, FloatArray, Progress

TOGETHER = 64  # candidates whose gains are computed together: for time and memory only


@dataclass(frozen=True, eq=False)
class Ranked:
    """A candidate's linear gain beyond a set, and the factors of its amplitudes."""

    candidate: Candidate
    nats: float
    factors: FloatArray

    @property
    def fit(self) -> FittedEffect:
        """The candidate at its first estimate."""
        return FittedEffect(self.candidate, self.candidate.scaled(self.factors))


def rank(
    search: Search,
    linearised: Linearisation,
    without: Sequence[Candidate] = (),
    channels: BoolArray | None = None,
    beyond: Sequence[Candidate] | None = None,
) -> list[Ranked]:
    """Linear held-out gain of every candidate beyond a set, the best variant of each, largest first.

    Parameters
    ----------
    search : Search
    linearised : Linearisation, the set, whose free numbers move along with the candidate's
    without : sequence of Candidate, not to be looked at, whatever their numbers
    channels : (c,) bool array, optional, only candidates that show in one of these
    beyond : sequence of Candidate, optional, only shapes of these that have more numbers than they have
    """
    fewest = {} if beyond is None else {c.key: c.extra for c in beyond}
    taken = {m.candidate.key for m in linearised.fitted} | {c.key for c in without}
    wanted = [
        t
        for t in search.traces
        if t.candidate.key not in taken
        and (channels is None or (t.touched & channels).any())
        and (beyond is None or t.candidate.extra > fewest.get(t.candidate.key, t.candidate.extra))
    ]
    best: dict[Hashable, Ranked] = {}
    gains = _gains_of(search, linearised, [t.change for t in wanted])
    for trace, (factors, gain) in zip(wanted, gains, strict=True):
        candidate, nats = trace.candidate, gain
        if candidate.starts_as_it_is:  # no line: a torque cut at 14 N is not three times one cut at 15
            new = search.whitened(trace.change)[:, 0]
            nats = max(nats, float(new @ (linearised.z - 0.5 * new)))
        nats -= SEARCH.complexity * candidate.extra
        slot = candidate.key if beyond is None else (candidate.key, *candidate.places)  # fuller ones: one of each make
        if _is_physical(candidate, factors) and (slot not in best or nats > best[slot].nats):
            best[slot] = Ranked(candidate, nats, factors)
    return sorted(best.values(), key=lambda r: -r.nats)


def _gains_of(search: Search, linearised: Linearisation, changes: Sequence[Change]) -> list[tuple[FloatArray, float]]:
    """Factors of changes of the channels, and what each gains beyond a set, held out."""
    whitener = search.whitener
    beside = Beside(linearised.slopes, linearised.z, whitener.block, SEARCH.foretold)
    found: dict[int, tuple[FloatArray, float]] = {}
    alike: dict[tuple[bytes, int], list[int]] = {}
    for i, change in enumerate(changes):
        alike.setdefault((change.shown.tobytes(), change.columns.shape[2]), []).append(i)
    for (_, size), together in alike.items():
        shown = changes[together[0]].shown
        for some in (together[k : k + TOGETHER] for k in range(0, len(together), TOGETHER)):
            new = whitener.whiten_columns(np.concatenate([changes[i].columns for i in some], axis=2), shown)
            factors, nats = beside.gains(new.reshape(len(new), len(some), size), shown[whitener.channel])
            found.update(zip(some, zip(factors, nats.tolist(), strict=True), strict=True))
    return [found[i] for i in range(len(changes))]


def _is_physical(candidate: Candidate, factors: FloatArray) -> bool:
    """Whether amplitudes that cannot be negative are not, nor the whole of an effect that has none."""
    if not candidate.amplitudes:
        return bool((factors > 0).all())
    one_sided = [candidate.coordinates[i] for i in candidate.amplitudes]
    return all(f > 0 for c, f in zip(one_sided, factors, strict=True) if c.parameter.positive or c.kind == "inverse")


def search(
    state: Search,
    *,
    rounds: int,
    refused: Sequence[Candidate] = (),
    progress: Progress | None = None,
) -> Search:
    """Add effects while they pay, and take out those that no longer do.

    In each round at most one a joint of those that show in a common channel: only they may stand in for each other.

    Parameters
    ----------
    state : Search
    rounds : int
    refused : sequence of Candidate, not to be added
    progress : Progress, optional
    """
    refused, progress = list(refused), progress or Progress()
    for number in range(rounds):
        threshold = penalty(state.n_kinds, number)
        added: list[Candidate] = []
        while (grown := _forward(state, threshold, added, refused)) is not state:
            state = grown
        progress.step("search", (number + 1) / rounds)
        if not added:
            break
        state = _physical(_merged(state, threshold), refused)
        state = _backward(state, threshold).refreshed()
    progress.step("search", 1.0)
    return state


@dataclass(frozen=True, eq=False)
class _Grown:
    """A set with a new effect, which is its last, and what that gains, less what its numbers cost."""

    fitted: tuple[FittedEffect, ...]
    gain: float

    @property
    def new(self) -> Candidate:
        """The new effect."""
        return self.fitted[-1].candidate


def _forward(state: Search, threshold: float, added: list[Candidate], refused: Sequence[Candidate]) -> Search:
    """Add the best of the refined leaders where this round has added none; the same state if none pays.

    A linear gain is a promise, and one that is not kept says nothing of what shows in other channels.
    """
    linearised = linearise(state.whitener, state.fitted)

    def is_open(new: Candidate) -> bool:
        return not any(new.joint == known.joint and state.alike(new, known) for known in added)

    ranked = [r for r in rank(state, linearised, refused) if r.nats > 0 and is_open(r.candidate)]
    best: _Grown | None = None
    while ranked and best is None:
        leader = ranked[0].candidate
        best = _best_of(state, linearised, [r for r in ranked if state.alike(r.candidate, leader)], threshold)
        ranked = [r for r in ranked if r.nats > threshold and not state.alike(r.candidate, leader)]
    if best is None:
        return state
    worth = state.misfit(best.fitted)
    for fuller in rank(state, linearised, refused, beyond=[best.new]):  # such as one that has a home
        grown = _grown(state, linearised, fuller, worth)
        if grown is not None and grown.gain > best.gain:
            best = grown
    added.append(best.new)
    steps = (*state.waterfall, Step(best.new.label, best.gain))
    return replace(state, fitted=best.fitted, waterfall=steps).refreshed()


def _best_of(state: Search, linearised: Linearisation, ranked: Sequence[Ranked], threshold: float) -> _Grown | None:
    """Refine a few of those near the first of some candidates, and return the best; None where it does not pay."""
    near = [r for r in ranked if r.nats > SEARCH.near_leader * ranked[0].nats]
    best, worth, refined = None, state.misfit(state.fitted), 0
    for leader in _ranked_there(state, linearised, _one_of_each_signature(near)[: SEARCH.looked_at]):
        grown = _grown(state, linearised, leader, worth)
        if grown is not None and (best is None or grown.gain > best.gain):
            best, worth = grown, state.misfit(grown.fitted)
        refined += grown is not None
        if refined == SEARCH.refined:
            break
    pays = best is not None and best.gain + SEARCH.complexity * best.new.extra >= threshold
    return best if pays else None


def _grown(state: Search, linearised: Linearisation, leader: Ranked, worth: float) -> _Grown | None:
    """Add a candidate and fit the numbers anew; None where that is no machine, or will not come to a misfit."""
    fitted = state.refit_with(state.fitted, leader.fit, worth)
    if fitted is None:
        return None
    gain = _gain_over(state, linearised, fitted, leader.fit)
    return _Grown(fitted, gain - SEARCH.complexity * leader.candidate.extra)


def _one_of_each_signature(ranked: Sequence[Ranked]) -> list[Ranked]:
    """Return the first of those with one name and one signature, such as a friction on either side of a rigid cable.

    That one signature gives one gain is taken to hold the other way round.
    """
    best: list[Ranked] = []
    for leader in ranked:
        if not any(leader.candidate.called_like(b.candidate) and np.isclose(leader.nats, b.nats) for b in best):
            best.append(leader)
    return best


def _ranked_there(state: Search, linearised: Linearisation, leaders: Sequence[Ranked]) -> list[Ranked]:
    """Rank a few again by the change that they make at their first estimates, no longer at their start.

    What does not grow as a line, such as a capstan's friction, may be far better than it looked; what is no machine at
    the size that its line asks for is none of them.
    """
    residual = state.residual(linearised.fitted)

    def left_by(leader: Ranked) -> FloatArray | None:
        try:
            return state.residual((*linearised.fitted, leader.fit))
        except DataError:  # no machine
            return None

    left = each_here(left_by, leaders)
    machines = [leader for leader, there in zip(leaders, left, strict=True) if there is not None]
    changes = [Change.of((residual - there)[:, :, None]) for there in left if there is not None]
    gains = zip(machines, _gains_of(state, linearised, changes), strict=True)
    found = [replace(r, nats=nats - SEARCH.complexity * r.candidate.extra) for r, (_, nats) in gains]
    return sorted(found, key=lambda r: -r.nats)


def _gain_over(
    state: Search,
    before: Linearisation,
    fitted: Sequence[FittedEffect],
    new: FittedEffect,
    channels: BoolArray | None = None,
) -> float:
    """Return the held-out log Bayes factor of a set with a new effect against another one, by the overdispersion.

    That of these channels `(c,)`, by default of those in which the new effect shows.
    """
    after = state.linearise_near(fitted, new.candidate)
    slopes_before = state.linearise_near(before.fitted, new.candidate).slopes
    nats = held_out(state.whitener, before.z, after.z, after.slopes)
    nats -= held_out(state.whitener, before.z, before.z, slopes_before)
    return float(nats.sum()) / state.overdispersion(
        after.z, state.touched(new.candidate) if channels is None else channels
    )


def _merged(state: Search, threshold: float) -> Search:
    """Put one effect in the place of two where it explains as much: two off-grid guesses of one thing.

    On one joint any effect may; for two at different places that show in common channels, a fuller shape of either.
    (An insertion that is dragged along from where it was homed is off by a constant, which a tracker alone takes for a
    longer tool as well.) What the whole machine has in common, a delay, no shape at one place can have.
    """
    most: dict[Hashable, int] = {}
    for trace in state.traces:
        most[trace.candidate.key] = max(trace.candidate.extra, most.get(trace.candidate.key, 0))
    for a, b in combinations(state.fitted, 2):
        one_joint = a.candidate.joint == b.candidate.joint
        may_be_fuller = any(most.get(m.candidate.key, 0) > m.candidate.extra for m in (a, b))
        of_all = "all" in (a.candidate.joint, b.candidate.joint)
        if not one_joint and (of_all or not (may_be_fuller and state.alike(a.candidate, b.candidate))):
            continue
        rest = tuple(m for m in state.fitted if m is not a and m is not b)
        bare = state.linearise_near(rest, a.candidate)
        both = state.touched(a.candidate) & state.touched(b.candidate)
        pair = _gain_over(state, bare, state.fitted, b, both)
        touched = state.touched(a.candidate)
        worth = state.misfit(state.fitted) + threshold * state.overdispersion(
            state.whitener.whiten(state.residual(state.fitted)), touched
        )
        others = rank(state, bare, [a.candidate, b.candidate], touched)[:1] if one_joint else []
        fuller = rank(state, bare, channels=touched, beyond=[a.candidate, b.candidate])[: SEARCH.refined]
        for leader in [*(r for r in others if r.nats > 0.8 * pair), *fuller]:
            fitted = state.refit_with(rest, leader.fit, worth)
            if fitted is None:
                continue
            one = _gain_over(state, bare, fitted, leader.fit, both)
            if one > pair - threshold:
                label = f"{leader.candidate.label} for {a.candidate.label} and {b.candidate.label}"
                steps = (*state.waterfall, Step(label, one - pair))
                return replace(state, fitted=fitted, waterfall=steps).refreshed()
    return state


def _without(state: Search, gone: FittedEffect, why: str, nats: float) -> Search:
    """Return the state without an effect, the others' numbers fitted anew."""
    rest = state.refit([m for m in state.fitted if m is not gone], gone.candidate)
    steps = (*state.waterfall, Step(f"without {gone.candidate.label}{why}", nats))
    return replace(state, fitted=rest, waterfall=steps)


def _physical(state: Search, refused: list[Candidate]) -> Search:
    """Take out effects whose numbers have left for the edge of their range as others came; they do not come again."""
    while edgy := [m for m in state.fitted if m.at_edge]:
        refused.append(edgy[-1].candidate)
        state = _without(state, edgy[-1], ", not physical", 0.0)
    return state


def _backward(state: Search, threshold: float) -> Search:
    """Take out effects that the others make superfluous, the least useful first."""
    while len(state.fitted) > 1:
        worth = []
        for fit in state.fitted:
            try:
                rest = state.linearise_near([m for m in state.fitted if m is not fit], fit.candidate)
                worth.append(_gain_over(state, rest, state.fitted, fit))
            except DataError:  # without it the others are no machine, such as a gain that it makes up for
                worth.append(np.inf)
        least = int(np.argmin(worth))
        if worth[least] >= threshold:
            break
        state = _without(state, state.fitted[least], "", -worth[least])
    return state
