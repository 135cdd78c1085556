"""What an effect may be called: its level, its probability, and what else could stand in its place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gpcorrect.discrepancy.naming.weigh import Weighed
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.settings import NAMING, SEARCH

__all__ = ["Alternative", "Explanation", "Level", "Named", "posterior"]


class Level(StrEnum):
    """What can be said: of a whole recording, and (all but NONE) of an effect."""

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
        *(Alternative.of(r.candidate, r.nats - cost) for r in rivals),
    ]
    own, between_effects = alternatives[0], _rival_overdispersion(weighed, cost)
    odds = np.array(
        [
            (a.nats - own.nats) / (between_effects if a.is_effect else weighed.overdispersion)
            - SEARCH.complexity * (a.extra - own.extra)
            for a in alternatives
        ]
    )
    weight = np.exp(odds - odds.max())
    return [replace(a, probability=float(w)) for a, w in zip(alternatives, weight / weight.sum(), strict=True)]


def _rival_overdispersion(weighed: Weighed, cost: float) -> float:
    """By how much nats between two effects count less while something else is still missing.

    What neither explains, and the smooth model sees beside them, may favour either by as much as it is: a lead of that
    size leaves the rival at e^-3, the edge of the stable set. So does a lead that a small error in the shape of our own
    signatures could make: both are models, and neither is exact.
    """
    tolerated = max(weighed.unknown.beside - cost, NAMING.shape_error**2 * weighed.nats)
    return max(weighed.overdispersion, tolerated / float(-np.log(NAMING.stable)))


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
