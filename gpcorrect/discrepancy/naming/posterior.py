"""What an effect may be called: what else could stand in its place, how probable it is, and the level that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gpcorrect.discrepancy.naming.intervals import away_from_nothing, explained_by_others, undetermined
from gpcorrect.discrepancy.naming.weigh import Own, View, Weighed, between_effects, smooth_nats, weigh
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.discrepancy.settings import NAMING, SEARCH
from gpcorrect.types import BoolArray, FloatArray


class Level(StrEnum):
    """What can be concluded: of a whole recording, and (all but NONE) of an effect."""

    NONE = "NONE"
    EXACT = "EXACT"
    CLASS = "CLASS"
    SET = "SET"
    UNKNOWN = "UNKNOWN"
    INCONCLUSIVE = "INCONCLUSIVE"


class Explanation(StrEnum):
    """Kinds of things that could stand in an effect's place."""

    EFFECT = "effect"
    NOTHING = "nothing"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Alternative:
    """One thing that could stand in an effect's place.

    Parameters
    ----------
    explanation : Explanation
        An effect, nothing, or something outside the catalogue.
    nats : float
        Held-out log Bayes factor against nothing, the prior's penalty taken off.
    label : str
        The candidate's; "nothing" or "unknown".
    name : str
        Canonical name; empty for nothing and unknown.
    joint : int, str or None
        Where.
    family : str
        Class of the effect.
    extra : int
        How many numbers it has beyond the first.
    paid : bool
        Whether its nats are an evidence in which those have been paid for.
    probability : float
        Posterior among the alternatives.
    """

    explanation: Explanation
    nats: float
    label: str
    name: str = ""
    joint: int | str | None = None
    family: str = ""
    extra: int = 0
    paid: bool = False
    probability: float = 0.0

    @classmethod
    def of(cls, candidate: Candidate, nats: float) -> Alternative:
        """Return a candidate as an alternative.

        Parameters
        ----------
        candidate : Candidate
            The effect.
        nats : float
            Its log Bayes factor against nothing.
        """
        c = candidate
        return cls(Explanation.EFFECT, nats, c.label, c.name, c.joint, c.family, c.extra)

    @property
    def is_effect(self) -> bool:
        """Whether it is an effect of the catalogue."""
        return self.explanation == Explanation.EFFECT


@dataclass(frozen=True, eq=False)
class Named:
    """An effect with the level at which it may be named.

    Parameters
    ----------
    fit : FittedEffect
        The effect.
    level : Level
        EXACT, CLASS, SET, UNKNOWN or INCONCLUSIVE.
    probability : float
        Posterior of this very effect.
    nats : float
        Held-out log Bayes factor on discovery and confirmation, divided by the overdispersion.
    alternatives : tuple of Alternative
        With nothing and unknown, most probable first.
    reasons : tuple of str
        Why it is not EXACT.
    """

    fit: FittedEffect
    level: Level
    probability: float
    nats: float
    alternatives: tuple[Alternative, ...]
    reasons: tuple[str, ...]

    @property
    def may_be_named(self) -> bool:
        """Whether the level is one with names."""
        return self.level in (Level.EXACT, Level.CLASS, Level.SET)

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """Other effects that cannot be ruled out."""
        own = self.fit.candidate.label
        return tuple(a for a in self.alternatives if a.is_effect and a.label != own and a.probability >= NAMING.stable)


def posterior(candidate: Candidate, weighed: Weighed, cost: float) -> list[Alternative]:
    """Weigh an effect against nothing, unknown and its rivals.

    Parameters
    ----------
    candidate : Candidate
        The effect.
    weighed : Weighed
        Its evidence, and that of what could stand in its place.
    cost : float
        Prior nats that any effect costs.

    Returns
    -------
    list of Alternative
        The effect itself, nothing, unknown, and the rivals that would be called something else; probabilities sum to 1.
    """
    rivals = [r for r in weighed.rivals if not r.candidate.called_like(candidate)]
    alternatives = [
        Alternative.of(candidate, weighed.nats - cost),
        Alternative(Explanation.NOTHING, 0.0, "nothing"),
        Alternative(Explanation.UNKNOWN, _unknown_nats(weighed, cost) - cost, "unknown"),
        *(replace(Alternative.of(r.candidate, r.nats - cost), paid=r.is_general) for r in rivals),
    ]
    own = alternatives[0]
    between = between_effects(weighed.nats, weighed.overdispersion, weighed.unknown, cost)
    odds = np.array(
        [
            (a.nats - own.nats) / (between if a.is_effect else weighed.overdispersion)
            - (0.0 if a.paid else SEARCH.complexity * (a.extra - own.extra))
            for a in alternatives
        ]
    )
    weight = np.exp(odds - odds.max())
    return [replace(a, probability=float(w)) for a, w in zip(alternatives, weight / weight.sum(), strict=True)]


def _unknown_nats(weighed: Weighed, cost: float) -> float:
    """Nats of "something outside the catalogue" against this effect.

    Each with the smooth model beside it where that pays.

    A flexible model can say whatever a simple effect says. It speaks against the effect only when it has much to say
    besides: an effect with strong evidence and a small remainder stands.
    """
    unknown = weighed.unknown
    nats = unknown.instead - max(0.0, unknown.beside - cost)
    strong = weighed.nats > NAMING.strong * weighed.overdispersion
    if strong and unknown.beside <= NAMING.unknown_fraction * weighed.nats:
        return min(nats, weighed.nats - 2 * cost * weighed.overdispersion)
    return nats


def fraction_closed(search: Search, fit: FittedEffect) -> float:
    """Return the fraction of the mean square above noise that the set closes in an effect's channels.

    On discovery and confirmation, sample by sample; every channel counts by what the effect changes there beside its
    noise. 1 where what is left may be noise, and is no more than there was: a part of something else may help one
    sensor and harm another.

    Parameters
    ----------
    search : Search
        Data, signatures and the fitted effects.
    fit : FittedEffect
        One of the set.
    """
    rows = search.dataset.training
    before, after = (_mean_square(search.residual(fitted), rows) for fitted in ((), search.fitted))
    noise = search.whitener.std**2
    change = _mean_square(search.dataset.predict([fit.effect]) - search.dataset.predict(), rows)
    touched = search.touched(fit.candidate) & (change > 0.0)
    if not touched.any():
        return 1.0
    worth = touched & (before > noise)
    no_worse = after <= before + NAMING.worse * noise
    closed = np.where((after <= NAMING.plain_rest**2 * noise) & no_worse, 1.0, 0.0)
    closed[worth] = np.maximum(closed, 1.0 - (after - noise) / np.where(worth, before - noise, 1.0))[worth]
    weight = np.where(touched, change / noise, 0.0)
    return float(weight @ closed / weight.sum())


def _mean_square(values: FloatArray, rows: BoolArray) -> FloatArray:
    return np.asarray(np.nanmean(values[rows] ** 2, axis=0))


def overtone_nats(view: View, fit: FittedEffect) -> float:
    """Return the log Bayes factor of an effect's overtones beside the set; 0 for effects that have none.

    Parameters
    ----------
    view : View
        The search, seen on discovery and confirmation.
    fit : FittedEffect
        One of the set.
    """
    effects = fit.effect.overtones()
    if not effects:
        return 0.0
    dataset = view.search.dataset
    columns = np.stack([dataset.predict([e]) - dataset.predict() for e in effects], axis=2)
    return smooth_nats(view, view.search.fitted, view.search.touched(fit.candidate), view.whitened(columns))


def name_effect(view: View, fit: FittedEffect, own: Own | None = None) -> tuple[Named, Weighed]:
    """Weigh one effect of a finished search, and say at what level it may be named.

    Parameters
    ----------
    view : View
        The search, seen on discovery and confirmation.
    fit : FittedEffect
        One of the set.
    own : Own, optional
        What it gains, where that is known.
    """
    weighed = weigh(view, fit, own)
    cost = penalty(view.search.n_kinds)
    alternatives = posterior(fit.candidate, weighed, cost)
    doubts, partial = _doubts(view, fit, weighed, cost), _partial(view, fit, weighed, cost)
    level, more = _level(alternatives, doubts, partial)
    ordered = tuple(sorted(alternatives, key=lambda a: -a.probability))
    nats = weighed.nats / weighed.overdispersion
    return Named(fit, level, alternatives[0].probability, nats, ordered, (*doubts, *more)), weighed


def _doubts(view: View, fit: FittedEffect, weighed: Weighed, cost: float) -> list[str]:
    """Conditions of an exact name that an effect does not meet."""
    found, confirmed = (
        weighed.discovery.sum() / weighed.overdispersion,
        weighed.confirmation.sum() / weighed.overdispersion,
    )
    doubts = []
    if found < cost:
        doubts.append(f"gains only {found:.1f} nats on the discovery part, {cost:.1f} are needed")
    if confirmed < NAMING.confirmed:
        doubts.append(f"not confirmed: {confirmed:.1f} nats on the confirmation part")
    gains = np.concatenate([weighed.discovery, weighed.confirmation])[weighed.active]
    if len(gains) < NAMING.few:
        doubts.append(f"acts in only {len(gains)} of the trajectories")
    elif (fraction := float((gains > 0).mean())) < NAMING.positive_fraction:
        doubts.append(f"helps in only {100 * fraction:.0f} % of the trajectories in which it acts")
    return doubts + _doubts_of_numbers(view, fit, weighed)


def _partial(view: View, fit: FittedEffect, weighed: Weighed, cost: float) -> list[str]:
    """Signs that an effect is but a part of something that is not in the catalogue."""
    signs = []
    if (closed := fraction_closed(view.search, fit)) < NAMING.least_closed:
        signs.append(f"{100 * closed:.0f} % of the gap is closed where it shows, and the rest is no noise")
    if (more := overtone_nats(view, fit)) > max(NAMING.most_overtones * weighed.nats, cost * weighed.overdispersion):
        signs.append(
            f"its overtones gain {more / weighed.overdispersion:.0f} nats more: a part of another periodic error"
        )
    return signs


def _doubts_of_numbers(view: View, fit: FittedEffect, weighed: Weighed) -> list[str]:
    search = view.search
    fixed, near = search.parted(search.fitted, fit.candidate)
    fitted = [*fixed, *near]
    index = next(i for i, m in enumerate(fitted) if m is fit)
    doubts = [f"{name} is at the edge of its physical range" for name in fit.at_edge]
    if not away_from_nothing(search, search.whitener, fitted, index):
        doubts.append("its size cannot be distinguished from zero")
    doubts += [
        f"these data do not determine its {name}" for name in undetermined(search, search.whitener, fitted, index)
    ]
    explained = explained_by_others(search, fitted, index)
    weak = weighed.nats < NAMING.strong * weighed.overdispersion or 1.0 - explained < NAMING.shape_error**2
    if explained > NAMING.explained and weak:
        doubts.append(
            f"{100 * explained:.1f} % of its signature is explained by the others: not nameable from these data"
        )
    return doubts


def _level(alternatives: Sequence[Alternative], doubts: Sequence[str], partial: list[str]) -> tuple[Level, list[str]]:
    if partial:
        return Level.UNKNOWN, partial
    own, others = alternatives[0], alternatives[1:]
    stable = [a for a in others if a.is_effect and a.probability >= NAMING.stable]
    nothing, unknown = others[0].probability, others[1].probability
    if unknown > 0.5:
        return Level.UNKNOWN, ["a smooth model outside the catalogue explains more"]
    if doubts or nothing > NAMING.stable:
        return Level.INCONCLUSIVE, []
    if own.probability >= NAMING.exact:
        return Level.EXACT, []
    if not stable:
        return Level.INCONCLUSIVE, ["the catalogue and a smooth model explain it equally well"]
    words = [f"cannot be distinguished from {a.label} ({100 * a.probability:.0f} %)" for a in stable]
    return (Level.CLASS if all(a.family == own.family for a in stable) else Level.SET), words
