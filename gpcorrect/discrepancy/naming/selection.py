"""From a finished search to names.

What cannot be named is taken out, one at a time, and the rest weighed again without it. It may have stood in for
something else: beside what stays, that is looked for anew, and at once where its numbers were not physical.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import Burst, bursts_of
from gpcorrect.discrepancy.naming.numbers import estimate_numbers
from gpcorrect.discrepancy.naming.posterior import Named, name_effect
from gpcorrect.discrepancy.naming.weigh import Own, Rival, Weighed, own_gain
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.prepared import PreparedData, in_pieces
from gpcorrect.discrepancy.search.state import Search, Trace, View, penalty, start_search, view_of
from gpcorrect.discrepancy.search.stepwise import search as search_on
from gpcorrect.discrepancy.settings import BURSTS, NAMING
from gpcorrect.parallel import each_here
from gpcorrect.types import BoolArray, Progress

TINY = 1e-12  # odds


def name_effects(
    search: Search, prepared: PreparedData, *, progress: Progress | None = None
) -> tuple[Search, tuple[Named, ...], tuple[Named, ...]]:
    """Weigh every fit of a finished search; put better rivals in place, and take out what may not be named.

    An effect is weighed anew, once an effect that shows in its channels has gone or changed, before it is itself
    changed or named. Return the search with the named effects only, those in the same order, and the others with the
    reasons.

    Parameters
    ----------
    search : Search, finished
    prepared : PreparedData
    progress : Progress, optional, reported each pass
    """
    selection = _ModelSelection(search, prepared)
    total, progress = len(search.fitted), progress or Progress()
    while selection.step():
        progress.step("naming", len(selection.dropped) / (total + len(selection.dropped) + 1))
    progress.step("naming", 1.0)
    named = tuple(replace(selection.named(m), fit=m) for m in selection.search.fitted)
    dropped = {n.fit.candidate.key: n for n in selection.dropped}  # once each, as it was weighed last
    for came_back in selection.search.fitted:
        dropped.pop(came_back.candidate.key, None)
    return selection.search, named, tuple(dropped.values())


@dataclass(frozen=True, eq=False)
class _Known:
    """What an effect gains, and how it may be named, beside the others as they were when it was weighed."""

    candidate: Candidate
    beside: frozenset[Candidate]  # the others that show in its channels
    own: Own
    assessment: tuple[Named, Weighed] | None = None


@dataclass
class _ModelSelection:
    """A set of effects on its way to names; every step changes it once, or weighs one of them anew."""

    search: Search  # with the effects as they are now
    prepared: PreparedData
    known: dict[Hashable, _Known] = field(default_factory=dict)  # of each effect, by its key
    dropped: list[Named] = field(default_factory=list)  # taken out so far
    refused: list[Candidate] = field(default_factory=list)  # what is not looked for again
    # How often a rival took the place of each since the last search. It may come back once, for the others' numbers
    # were those beside it; two that each explain the other's must end.
    replaced: Counter[Hashable] = field(default_factory=Counter)
    found: set[Hashable] = field(default_factory=set)  # by searches for what was taken out, and what took their place
    filled: int = 0  # how many of the dropped the last search has looked for a replacement of
    view: View = field(init=False)  # of the search, at each step

    def step(self) -> bool:
        """Change the set once, or weigh one effect anew; False when there is nothing to change."""
        if not self.search.fitted:
            return self._search_again()
        self.view = view_of(self.search, self.prepared)
        fitted = self.search.fitted
        self.known = {known.candidate.key: known for known in each_here(self._of, fitted)}
        found = {m: self.known[m.candidate.key].own.found for m in fitted}
        # What gains less than an effect must goes first: no rivals need be weighed to know it.
        if self._drop_weakest({m: nats for m, nats in found.items() if nats < penalty(self.search.n_kinds)}):
            return True
        each_here(self._assess, fitted)
        if self._simplify() or self._swap():
            return True
        poor = (m for m in fitted if not self.named(m).may_be_named or self._is_outdone(m))
        if self._drop_weakest({m: self.named(m).nats for m in poor}) or any(each_here(self._renew, fitted)):
            return True
        return self._search_again() or self._drop_unsure()

    def named(self, fit: FittedEffect) -> Named:
        """How an effect may be named.

        Parameters
        ----------
        fit : FittedEffect, one of the set
        """
        return self._assess(fit)[0]

    def _of(self, fit: FittedEffect) -> _Known:
        """Return what is known of an effect; of one that is new, or back, what it gains."""
        known = self.known.get(fit.candidate.key)
        if known is not None and known.candidate == fit.candidate:
            return known
        return _Known(fit.candidate, self._beside(fit), own_gain(self.view, fit))

    def _assess(self, fit: FittedEffect) -> tuple[Named, Weighed]:
        key = fit.candidate.key
        known = self.known[key]
        if known.assessment is None and not self._renew(fit):
            self.known[key] = replace(known, assessment=name_effect(self.view, fit, known.own))
        found = self.known[key].assessment
        assert found is not None
        return found

    def _renew(self, fit: FittedEffect) -> bool:
        """Weigh an effect anew if there are others beside it than there were; whether it was."""
        beside = self._beside(fit)
        if self.known[fit.candidate.key].beside == beside:
            return False
        own = own_gain(self.view, fit)
        self.known[fit.candidate.key] = _Known(fit.candidate, beside, own, name_effect(self.view, fit, own))
        return True

    def _beside(self, fit: FittedEffect) -> frozenset[Candidate]:
        """Return the others of the set that show in an effect's channels."""
        others = (m.candidate for m in self.search.fitted if m is not fit)
        return frozenset(c for c in others if self.search.alike(c, fit.candidate))

    def _simplify(self) -> bool:
        """Take from an effect what it has beside its law, such as a drag, where no data determine the shape of that."""
        for fit in self.search.fitted:
            undetermined = self.named(fit).undetermined
            beside = {c.parameter.name for c in fit.candidate.coordinates if c.parameter.shaped_by in undetermined}
            law = fit.candidate.places.keys() - beside - set(undetermined)
            same = (t.candidate for t in self.search.traces if t.candidate.key == fit.candidate.key)
            simple = next((c for c in same if beside and c.places.keys() == law), None)
            if simple is not None and self._renew(fit):
                return True
            if simple is not None:
                numbers = zip(fit.candidate.coordinates, fit.u, strict=True)
                new = FittedEffect(simple, np.array([u for c, u in numbers if c.parameter.name in law]))
                rest = (m for m in self.search.fitted if m is not fit)
                self._change(self.search.refit((*rest, new), simple))
                return True
        return False

    def _swap(self) -> bool:
        """Put the rival that leads most in an effect's place, if any is more probable or explains more."""
        out: set[Hashable] = {key for key, times in self.replaced.items() if times > 1}
        pairs = [
            (self._lead(fit, rival), fit, rival.fit)
            for fit in self.search.fitted
            for rival in self._assess(fit)[1].rivals
            if rival.candidate.key not in out and self._may_return(rival, fit)
        ]
        lead, place, new = max(pairs, key=lambda pair: pair[0], default=(0.0, None, None))
        if place is None or new is None or lead <= 0.0:
            return False
        if self._renew(place):
            return True
        self.replaced[place.candidate.key] += 1
        if place.candidate.key in self.found:
            self.found.add(new.candidate.key)
        rest = (m for m in self.search.fitted if m is not place)
        self._change(self.search.refit((*rest, new), new.candidate))
        return True

    def _may_return(self, rival: Rival, fit: FittedEffect) -> bool:
        """Whether a rival was not taken out; or but once, beside other effects, and what is in its place is no name."""
        times = [n.fit.candidate.key for n in self.dropped].count(rival.candidate.key)
        return times == 0 or (times == 1 and self._is_outdone(fit))

    def _is_outdone(self, fit: FittedEffect) -> bool:
        """Whether its rivals leave an effect a chance that would rule out any of them."""
        return self.named(fit).probability < NAMING.stable

    def _lead(self, fit: FittedEffect, rival: Rival) -> float:
        """Log odds of a rival in a fit's place, or nats by which it explains more.

        Beside a fit that says less there seems to be more that is missing, which makes either as probable. So what
        explains more is weighed in its place: once, for then its own odds are known.
        """
        named, weighed = self._assess(fit)
        gain = (rival.nats - weighed.own.nats) / weighed.own.overdispersion - (rival.price - weighed.price)
        if rival.candidate.called_like(fit.candidate):
            return gain
        chance = next((a.probability for a in named.alternatives if a.label == rival.candidate.label), 0.0)
        odds = float(np.log(max(chance, TINY) / max(named.probability, TINY)))
        return odds if self.replaced[rival.candidate.key] else max(gain, odds)

    def _drop_weakest(self, poor: Mapping[FittedEffect, float]) -> bool:
        """Take the one out that gains least of those that must go, by their nats, or weigh it anew; False for none."""
        if not poor:
            return False
        weakest = min(poor, key=poor.__getitem__)
        if not self._renew(weakest):
            self._take_out(weakest, self.named(weakest))
        return True

    def _drop_unsure(self) -> bool:
        """Take the weakest of those out whose size may be nothing once both parts are seen together."""
        unsure = [self.search.fitted[i] for i in estimate_numbers(self.search, self.search.fitted).unsure]
        if not unsure:
            return False
        weakest = min(unsure, key=lambda m: self.known[m.candidate.key].own.nats)
        self._take_out(weakest, self.named(weakest).in_doubt())
        return True

    def _take_out(self, fit: FittedEffect, named: Named) -> None:
        self.dropped.append(named)
        self.refused.append(fit.candidate)
        if named.undetermined:  # nor would the numbers of those be, that differ from it in a detail
            likely = (t.candidate for t in self.search.traces if t.candidate.called_like(fit.candidate))
            self.refused += (c for c in likely if c.places.keys() == fit.candidate.places.keys())
        self._change(self.search.refit([m for m in self.search.fitted if m is not fit], fit.candidate))
        if fit.at_edge:
            self._search_again()

    def _search_again(self) -> bool:
        """Look for what the effects taken out since the last search had stood in for, if they leave a hole.

        What a search found and went again leaves the hole in which was searched.
        """
        gone, self.filled = self.dropped[self.filled :], len(self.dropped)
        new = [n for n in gone if n.fit.candidate.key not in self.found]
        holes = [n.fit.candidate for n in new if n.fit.at_edge or n.nats > NAMING.hole]
        if not holes:
            return False
        before = {m.candidate.key for m in self.search.fitted}
        traces = self.search.traces
        elsewhere = (t.candidate for t in traces if not any(self.search.alike(t.candidate, hole) for hole in holes))
        found = search_on(self.search, rounds=NAMING.search_rounds, refused=[*self.refused, *elsewhere])
        if found is self.search:
            return False
        self.found |= {m.candidate.key for m in found.fitted} - before
        self.replaced, self.search = Counter(), found
        return True

    def _change(self, fitted: Sequence[FittedEffect]) -> None:
        self.search = replace(self.search, fitted=tuple(fitted))


def name_rare(
    prepared: PreparedData,
    state: Search,
    named: tuple[Named, ...],
    candidates: Sequence[Candidate],
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[PreparedData, Search, tuple[Named, ...]]:
    """Look, beside what is named, for effects that act where something rare happens and hardly anywhere else.

    Such as a limit that is reached once. No motion can foretell another's there, so that evidence from motion to motion
    has nothing to say. But what happens lasts for many samples, and a law with few numbers that is fitted to some of
    them has to foretell the others. Return the recording in pieces, the state with the new effects, and all that is
    named; each as it was when nothing rare gets a name.

    Parameters
    ----------
    prepared : PreparedData, by whole trajectories
    state : Search, after the naming
    named : tuple of Named, what was named, in the order of the state's effects
    candidates : sequence of Candidate, all that these data could show
    rng : numpy.random.Generator, deals the pieces
    progress : Progress
    """
    found = bursts_of(prepared.dataset, state.whitener.noises, [f.effect for f in state.fitted])
    bursts = [b for b in found if b.rare]
    if not bursts:
        return prepared, state, named
    cut = in_pieces(prepared, bursts, rng)
    start = start_search(cut.dataset, candidates, progress)
    seldom = tuple(t for t in start.traces if _only_there(t, cut, bursts))
    start = replace(start, traces=seldom, fitted=state.fitted).refreshed()
    done = search_on(start, rounds=NAMING.search_rounds, progress=progress)
    if len(done.fitted) == len(start.fitted):
        return prepared, state, named
    done, names, _ = name_effects(done, cut, progress=progress)
    known = {n.fit.candidate.key for n in named}
    new = tuple(n for n in names if n.fit.candidate.key not in known)
    if not new:
        return prepared, state, named
    steps, fitted = (*state.waterfall, *done.waterfall), (*state.fitted, *(n.fit for n in new))
    return cut, replace(done, fitted=fitted, waterfall=steps), (*named, *new)


def _only_there(trace: Trace, cut: PreparedData, bursts: Sequence[Burst]) -> bool:
    """Whether a candidate changes a channel with a burst, and hardly anything in other trajectories."""
    dataset = cut.dataset
    there = trace.change.columns[:, trace.touched[trace.change.shown]]
    shown: BoolArray = np.array([c in {b.channel for b in bursts} for c in dataset.scene.channels]) & trace.touched
    rows = np.isin(dataset.trajectory, [t for b in bursts for t in b.trajectories])
    energy = np.square(there).sum(axis=(1, 2))
    return bool(shown.any() and energy[rows].sum() > BURSTS.there * energy.sum())
