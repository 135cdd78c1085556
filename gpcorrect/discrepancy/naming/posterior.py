"""What an effect may be called: what else could stand in its place, how probable it is, and the level that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gpcorrect.discrepancy.naming.intervals import away_from_nothing, explained_by_others, size_spread, undetermined
from gpcorrect.discrepancy.naming.smooth_model import smooth_nats
from gpcorrect.discrepancy.naming.weigh import Own, Weighed, between_effects, weigh
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.state import Search, View, penalty
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.sim.body import Drive


class Level(StrEnum):
    """What can be concluded: of a whole recording, and (all but NONE) of an effect."""

    NONE = "NONE"
    EXACT = "EXACT"
    CLASS = "CLASS"
    SET = "SET"
    UNKNOWN = "UNKNOWN"
    INCONCLUSIVE = "INCONCLUSIVE"


SURENESS = (Level.EXACT, Level.CLASS, Level.SET)  # levels with names, the surest first


class Explanation(StrEnum):
    """Kinds of things that could stand in an effect's place."""

    EFFECT = "effect"
    NOTHING = "nothing"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Alternative:
    """One thing that could stand in an effect's place."""

    explanation: Explanation
    probability: float  # posterior among the alternatives
    label: str  # the candidate's; "nothing" or "unknown"
    name: str = ""  # canonical, of an effect
    joint: int | str | None = None
    family: str = ""  # class of an effect
    source: int | None = None  # the joint that drives it, of a coupling or a cable that another joint pays out

    @classmethod
    def of(cls, candidate: Candidate, probability: float) -> Alternative:
        """Return a candidate as an alternative.

        Parameters
        ----------
        candidate : Candidate
        probability : float, posterior among the alternatives
        """
        c = candidate
        return cls(Explanation.EFFECT, probability, c.label, c.name, c.joint, c.family, dict(c.fixed).get("source"))

    @property
    def is_effect(self) -> bool:
        """Whether it is an effect of the catalogue."""
        return self.explanation == Explanation.EFFECT


@dataclass(frozen=True, eq=False)
class Named:
    """An effect with the level at which it may be named."""

    fit: FittedEffect
    level: Level
    probability: float  # posterior of this very effect
    nats: float  # held-out log Bayes factor on discovery and confirmation, divided by the overdispersion
    alternatives: tuple[Alternative, ...]  # with nothing and unknown, most probable first
    reasons: tuple[str, ...]  # why it is not EXACT
    spread: float = 0.0  # by how much its size differs between trajectories beyond noise, as a part of the size
    undetermined: tuple[str, ...] = ()  # numbers of its shape that these data leave open
    like_steps: bool = False  # whether an effect that cannot be ruled out is a matter of the servo's steps

    @property
    def may_be_named(self) -> bool:
        """Whether the level is one with names."""
        return self.level in SURENESS

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """Other effects that cannot be ruled out."""
        own = self.fit.candidate.label
        return tuple(_not_ruled_out([a for a in self.alternatives if a.is_effect and a.label != own], self.probability))

    def in_doubt(self) -> Named:
        """Return it as an effect whose size may be nothing after all."""
        reasons = (*self.reasons, "its 95 % interval holds zero")
        return replace(self, level=Level.INCONCLUSIVE, reasons=reasons)


def _not_ruled_out(rivals: Sequence[Alternative], own: float) -> list[Alternative]:
    """Return the rivals above the limit; else the best, if own and rivals together have an exact name's odds."""
    stable = [a for a in rivals if a.probability >= NAMING.stable]
    some_effect = own + sum(a.probability for a in rivals)
    if stable or own >= NAMING.exact or some_effect < NAMING.exact:
        return stable
    return [max(rivals, key=lambda a: a.probability)]


def posterior(candidate: Candidate, weighed: Weighed, cost: float) -> list[Alternative]:
    """Weigh an effect against nothing, unknown and its rivals, in this order; their probabilities sum to 1.

    Of the rivals those that would be called something else.

    Parameters
    ----------
    candidate : Candidate, the effect
    weighed : Weighed, its evidence, and that of what could stand in its place
    cost : float, prior nats that any effect costs
    """
    own, rivals = weighed.own, [r for r in weighed.rivals if not r.candidate.called_like(candidate)]
    nats = np.array([own.nats, cost, _unknown_nats(weighed, cost), *(r.nats for r in rivals)]) - cost
    counts = np.full(len(nats), between_effects(own, weighed.beside, cost))
    counts[1:3] = own.overdispersion
    price = np.array([weighed.price, 0.0, 0.0, *(r.price for r in rivals)]) - weighed.price
    lead = (nats - nats[0]) / counts
    least = np.array([0.0, 0.0, 0.0, *(min(c, r.shape_nats) for c, r in zip(price[3:], rivals, strict=True))])
    # A fuller law is charged for what the data say of its shape, no more than to a draw: it is not ruled out.
    doubt = np.where([False] * 3 + [r.shape_nats < np.inf for r in rivals], np.minimum(0.0, lead - least), -np.inf)
    odds = np.maximum(lead - price, doubt)
    weight = np.exp(odds - odds.max())
    mine, nothing, unknown, *others = (weight / weight.sum()).tolist()
    return [
        Alternative.of(candidate, mine),
        Alternative(Explanation.NOTHING, nothing, "nothing"),
        Alternative(Explanation.UNKNOWN, unknown, "unknown"),
        *(Alternative.of(r.candidate, p) for r, p in zip(rivals, others, strict=True)),
    ]


def _unknown_nats(weighed: Weighed, cost: float) -> float:
    """Nats of "something outside the catalogue" against this effect, each with the smooth model beside it if that pays.

    A flexible model can say whatever a simple effect says. It speaks against the effect only when it has much to say
    besides: an effect with strong evidence and a small remainder stands.
    """
    own = weighed.own
    nats = weighed.instead - max(0.0, weighed.beside - cost)
    strong = own.nats > NAMING.strong * own.overdispersion
    if strong and weighed.beside <= NAMING.unknown_fraction * own.nats:
        return min(nats, own.nats - 2 * cost * own.overdispersion)
    return nats


def fraction_closed(search: Search, fit: FittedEffect) -> float:
    """Return the fraction of the mean square above noise that the set closes in an effect's channels.

    On discovery and confirmation, sample by sample; every channel counts by what the effect changes there beside its
    noise. 1 where what is left may be noise, and is no more than there was: a part of something else may help one
    sensor and harm another.

    Parameters
    ----------
    search : Search
    fit : FittedEffect, one of the set
    """
    rows, noise = search.dataset.training, search.whitener.std**2
    changed = search.dataset.predict([fit.effect]) - search.dataset.predict()
    errors = (search.residual(()), search.residual(search.fitted), changed)
    before, after, change = (np.nanmean(e[rows] ** 2, axis=0) for e in errors)
    touched = search.touched(fit.candidate) & (change > 0.0)
    if not touched.any():
        return 1.0
    worth = touched & (before > noise)
    no_worse = after <= before + NAMING.worse * noise
    closed = np.where((after <= NAMING.plain_rest**2 * noise) & no_worse, 1.0, 0.0)
    closed[worth] = np.maximum(closed, 1.0 - (after - noise) / np.where(worth, before - noise, 1.0))[worth]
    weight = np.where(touched, change / noise, 0.0)
    return float(weight @ closed / weight.sum())


def overtone_nats(view: View, fit: FittedEffect) -> float:
    """Return the log Bayes factor of an effect's overtones beside the set; 0 for effects that have none.

    Parameters
    ----------
    view : View
    fit : FittedEffect, one of the set
    """
    search, there = view.search, view.search.touched(fit.candidate)
    columns = view.whitened(search.dataset.changes(fit.effect.overtones())[:, there], there)
    return smooth_nats(view, search.fitted, there, columns)


def name_effect(view: View, fit: FittedEffect, own: Own) -> tuple[Named, Weighed]:
    """Weigh one effect of a finished search, and say at what level it may be named.

    Parameters
    ----------
    view : View
    fit : FittedEffect, one of the set
    own : Own, what it gains
    """
    weighed, cost = weigh(view, fit, own), penalty(view.search.n_kinds)
    alternatives = posterior(fit.candidate, weighed, cost)
    undecided = tuple(undetermined(view.search, fit))
    doubts = [*_doubts_of_evidence(weighed, cost), *_doubts_of_numbers(view, fit, own, undecided)]
    spread = size_spread(view.search, fit)
    level, more = _level(alternatives, doubts, _partial(view, fit, own, cost, spread))
    ordered = tuple(sorted(alternatives, key=lambda a: -a.probability))
    nats = own.nats / own.overdispersion
    named = Named(fit, level, alternatives[0].probability, nats, ordered, (*doubts, *more), spread, undecided)
    scene = view.search.dataset.scene
    return replace(named, like_steps=like_steps(named, weighed, scene.machine.drive, scene.joints)), weighed


def like_steps(named: Named, weighed: Weighed, drive: Drive, joints: tuple[int, ...]) -> bool:
    """Return whether an effect that cannot be ruled out in a name's place is a matter of the servo's steps.

    Two programs surely step a servo in two ways, and a machine seldom lacks an effect that looks the same.

    Parameters
    ----------
    named : Named
    weighed : Weighed, the effect beside its rivals
    drive : Drive, the nominal one
    joints : tuple of int, numbers of its columns
    """
    instead = {rival.label for rival in named.rivals}
    fits = [r.fit for r in weighed.rivals if r.candidate.label in instead]
    return any(fit.effect.is_a_matter_of_steps(drive, joints) for fit in fits)


def _doubts_of_evidence(weighed: Weighed, cost: float) -> list[str]:
    """Conditions of an exact name that an effect's nats do not meet."""
    own, doubts = weighed.own, []
    confirmed = own.confirmation.sum() / own.overdispersion
    if own.found < cost:
        doubts.append(f"gains only {own.found:.1f} nats on the discovery part, {cost:.1f} are needed")
    if not weighed.active[len(own.discovery) :].any():  # such as a slip after the last motion of that part
        if own.found < NAMING.strong:
            doubts.append("acts in no motion of the confirmation part, and is not beyond doubt in the others")
    elif confirmed < NAMING.confirmed:
        doubts.append(f"not confirmed: {confirmed:.1f} nats on the confirmation part")
    gains = np.concatenate([own.discovery, own.confirmation])[weighed.active]
    if len(gains) < NAMING.few:
        doubts.append(f"acts in only {len(gains)} of the trajectories")
    elif (fraction := float((gains > 0).mean())) < NAMING.positive_fraction:
        doubts.append(f"helps in only {100 * fraction:.0f} % of the trajectories in which it acts")
    return doubts


def _doubts_of_numbers(view: View, fit: FittedEffect, own: Own, undecided: Sequence[str]) -> list[str]:
    """Conditions of an exact name that its numbers do not meet."""
    search = view.search
    doubts = [f"{name} is at the edge of its physical range" for name in fit.at_edge]
    if not away_from_nothing(search, fit):
        doubts.append("its size cannot be distinguished from zero")
    doubts += [f"these data do not determine its {name}" for name in undecided]
    explained = explained_by_others(search, fit)
    weak = own.nats < NAMING.strong * own.overdispersion or 1.0 - explained < NAMING.shape_error**2
    if explained > NAMING.explained and weak:
        doubts.append(
            f"{100 * explained:.1f} % of its signature is explained by the others: not nameable from these data"
        )
    return doubts


def _partial(view: View, fit: FittedEffect, own: Own, cost: float, spread: float) -> list[str]:
    """Signs that an effect is but a part of something that is not in the catalogue."""
    signs = []
    if (closed := fraction_closed(view.search, fit)) < NAMING.least_closed:
        signs.append(f"{100 * closed:.0f} % of the gap is closed where it shows, and the rest is no noise")
    if spread > NAMING.steady:
        signs.append(f"its size differs from trajectory to trajectory by {100 * spread:.0f} % of itself")
    if (more := overtone_nats(view, fit)) > max(NAMING.most_overtones * own.nats, cost * own.overdispersion):
        signs.append(f"its overtones gain {more / own.overdispersion:.0f} nats more: a part of another periodic error")
    return signs


def _level(alternatives: Sequence[Alternative], doubts: Sequence[str], partial: list[str]) -> tuple[Level, list[str]]:
    if partial:
        return Level.UNKNOWN, partial
    own, nothing, unknown, *rivals = alternatives
    stable = _not_ruled_out(rivals, own.probability)
    if unknown.probability > 0.5:
        return Level.UNKNOWN, ["a smooth model outside the catalogue explains more"]
    if doubts or nothing.probability > NAMING.stable:
        return Level.INCONCLUSIVE, []
    if own.probability >= NAMING.exact:
        return Level.EXACT, []
    if not stable:
        return Level.INCONCLUSIVE, ["the catalogue and a smooth model explain it equally well"]
    words = [f"cannot be distinguished from {a.label} ({100 * a.probability:.0f} %)" for a in stable]
    return (Level.CLASS if all(a.family == own.family for a in stable) else Level.SET), words
