"""Probabilities of an effect, of nothing, of something outside the catalogue, and of what could stand in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpcorrect.discrepancy.naming.intervals import SHAPE_ERROR
from gpcorrect.discrepancy.naming.named import STABLE, Alternative
from gpcorrect.discrepancy.naming.weigh import Weighed
from gpcorrect.discrepancy.search.candidates import Candidate
from gpcorrect.discrepancy.search.state import COMPLEXITY

__all__ = ["UNKNOWN_SHARE", "posterior"]

UNKNOWN_SHARE = 0.25  # of an effect's nats, found beside it by the smooth model: then that model competes in full
STRONG = 30.0  # nats from which an effect with a small remainder stands against any smooth model


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
    return _with_probabilities(_alternatives(candidate, weighed, cost), weighed, cost)


def _alternatives(candidate: Candidate, weighed: Weighed, cost: float) -> list[Alternative]:
    """Effect, nothing, unknown, and the rivals; not those rivals that would be called the same."""
    rivals = [r for r in weighed.rivals if not r.candidate.called_like(candidate)]
    return [
        _alternative(candidate, weighed.nats - cost),
        Alternative("nothing", "", None, "", 0.0),
        Alternative("unknown", "", None, "", _unknown_nats(weighed, cost) - cost),
        *(_alternative(r.candidate, r.nats - cost) for r in rivals),
    ]


def _alternative(candidate: Candidate, nats: float) -> Alternative:
    return Alternative(candidate.label, candidate.name, candidate.joint, candidate.family, nats, candidate.extra)


def _with_probabilities(alternatives: Sequence[Alternative], weighed: Weighed, cost: float) -> list[Alternative]:
    """Probabilities from nats, tempered, and from the price of every number that an effect has beyond its first."""
    mine, rival_temper = alternatives[0], _rival_temper(weighed, cost)
    odds = np.array(
        [
            (a.nats - mine.nats) / (rival_temper if a.name else weighed.temper) - COMPLEXITY * (a.extra - mine.extra)
            for a in alternatives
        ]
    )
    weight = np.exp(odds - odds.max())
    return [replace(a, probability=float(w)) for a, w in zip(alternatives, weight / weight.sum(), strict=True)]


def _rival_temper(weighed: Weighed, cost: float) -> float:
    """By how much nats between two effects count less while something else is still missing.

    What neither explains, and the smooth model sees beside them, may favour either by as much as it is: a lead of that
    size leaves the rival at e^-3, the edge of the stable set. So does a lead that a small error in the shape of our own
    signatures could make: both are models, and neither is exact.
    """
    tolerated = max(weighed.unknown.beside - cost, SHAPE_ERROR**2 * weighed.nats)
    return max(weighed.temper, tolerated / float(-np.log(STABLE)))


def _unknown_nats(weighed: Weighed, cost: float) -> float:
    """Nats of "something outside the catalogue" against this effect.

    Each with the smooth model beside it where that pays.

    A flexible model can say whatever a simple effect says. It speaks against the effect only when it has much to say
    besides: an effect with strong evidence and a small remainder stands.
    """
    unknown = weighed.unknown
    nats = unknown.instead - max(0.0, unknown.beside - cost)
    strong = weighed.nats > STRONG * weighed.temper
    if strong and unknown.beside <= UNKNOWN_SHARE * weighed.nats:
        return min(nats, weighed.nats - 2 * cost * weighed.temper)
    return nats
