"""Which names may be given: the posterior of each effect against none, its rivals and the unknown.

And the level that follows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.naming.intervals import away_from_nothing, explained_by_others
from gpcorrect.discrepancy.naming.named import EXACT, STABLE, Alternative, EffectLevel, Named
from gpcorrect.discrepancy.naming.overtones import MOST_OVERTONES, overtone_nats
from gpcorrect.discrepancy.naming.posterior import posterior
from gpcorrect.discrepancy.naming.share import LEAST_SHARE, share_closed
from gpcorrect.discrepancy.naming.weigh import View, Weighed, weigh
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.state import penalty

__all__ = ["name_member"]

CONFIRMED = 3.0  # nats on the confirmation part
POSITIVE_SHARE = 0.6  # of the trajectories in which it acts
FEW = 3  # of those: below, they may be odd for a reason of their own
EXPLAINED = 0.95  # of a signature by the others: not nameable


def name_member(view: View, member: Member) -> tuple[Named, Weighed]:
    """Weigh one member of a finished search, and say at what level it may be named."""
    weighed = weigh(view, member)
    cost = penalty(view.search.n_kinds)
    alternatives = posterior(member.candidate, weighed, cost)
    doubts, partial = _doubts(view, member, weighed, cost), _partial(view, member, weighed, cost)
    level, more = _level(alternatives, doubts, partial)
    ordered = tuple(sorted(alternatives, key=lambda a: -a.probability))
    nats = weighed.nats / weighed.temper
    return Named(member, level, alternatives[0].probability, nats, ordered, (*doubts, *more)), weighed


def _doubts(view: View, member: Member, weighed: Weighed, cost: float) -> list[str]:
    """Conditions of an exact name that an effect does not meet."""
    found, confirmed = weighed.discovery.sum() / weighed.temper, weighed.confirmation.sum() / weighed.temper
    doubts = []
    if found < cost:
        doubts.append(f"gains only {found:.1f} nats on the discovery part, {cost:.1f} are needed")
    if confirmed < CONFIRMED:
        doubts.append(f"not confirmed: {confirmed:.1f} nats on the confirmation part")
    gains = np.concatenate([weighed.discovery, weighed.confirmation])[weighed.heard]
    if len(gains) < FEW:
        doubts.append(f"acts in only {len(gains)} of the trajectories")
    elif (share := float((gains > 0).mean())) < POSITIVE_SHARE:
        doubts.append(f"helps in only {100 * share:.0f} % of the trajectories in which it acts")
    return doubts + _doubts_of_numbers(view, member)


def _partial(view: View, member: Member, weighed: Weighed, cost: float) -> list[str]:
    """Signs that an effect is but a part of something that is not in the catalogue."""
    signs = []
    if (closed := share_closed(view.search, member)) < LEAST_SHARE:
        signs.append(f"{100 * closed:.0f} % of the gap is closed where it shows, and the rest is no noise")
    if (more := overtone_nats(view, member)) > max(MOST_OVERTONES * weighed.nats, cost * weighed.temper):
        signs.append(f"its overtones gain {more / weighed.temper:.0f} nats more: a part of another periodic error")
    return signs


def _doubts_of_numbers(view: View, member: Member) -> list[str]:
    search = view.search
    fixed, near = search.parted(search.members, member.candidate)
    members = [*fixed, *near]
    index = next(i for i, m in enumerate(members) if m is member)
    doubts = [f"{name} is at the edge of its physical range" for name in member.at_edge]
    if not away_from_nothing(search, search.lens, members, index):
        doubts.append("its size cannot be told from zero")
    explained = explained_by_others(search, members, index)
    if explained > EXPLAINED:
        doubts.append(
            f"{100 * explained:.1f} % of its signature is explained by the others: not nameable from these data"
        )
    return doubts


def _level(
    alternatives: Sequence[Alternative], doubts: Sequence[str], partial: list[str]
) -> tuple[EffectLevel, list[str]]:
    if partial:
        return "UNKNOWN", partial
    mine, others = alternatives[0], alternatives[1:]
    stable = [a for a in others if a.name and a.probability >= STABLE]
    nothing, unknown = others[0].probability, others[1].probability
    if unknown > 0.5:
        return "UNKNOWN", ["a smooth model outside the catalogue explains more"]
    if doubts or nothing > STABLE:
        return "INCONCLUSIVE", []
    if mine.probability >= EXACT:
        return "EXACT", []
    if not stable:
        return "INCONCLUSIVE", ["the catalogue and a smooth model explain it equally well"]
    words = [f"cannot be told from {a.label} ({100 * a.probability:.0f} %)" for a in stable]
    return ("CLASS" if all(a.family == mine.family for a in stable) else "SET"), words
