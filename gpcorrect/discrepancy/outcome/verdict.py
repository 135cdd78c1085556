"""The verdict: nothing, names, something unknown, or not enough to say."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.evidence.tolerated import MOST_TOLERATED, tolerated
from gpcorrect.discrepancy.naming.named import Named
from gpcorrect.discrepancy.naming.weigh import smooth_nats, view_of
from gpcorrect.discrepancy.outcome.result import Level, NamedEffect
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.discrepancy.search.laid import Laid
from gpcorrect.discrepancy.search.state import Search, penalty

__all__ = ["PLAIN", "SAID", "is_plain", "verdict"]

ORDER: tuple[Level, ...] = ("EXACT", "CLASS", "SET")
PLAIN = 3.0  # thresholds of the luckiest test
SAID = 0.5  # of a finding's nats: what an effect that was not named may have gained, and the finding stay unexplained


def verdict(
    laid: Laid,
    state: Search,
    before: Localisation,
    effects: Sequence[NamedEffect],
    members: Sequence[Member],
    dropped: Sequence[Named],
) -> Level:
    """Return what a run comes to.

    Parameters
    ----------
    laid : Laid
        The recording.
    state : Search
        Settled.
    before : Localisation
        Of the nominal model's residual.
    effects : sequence of NamedEffect
        Those that may be named, effects on noise too.
    members : sequence of Member
        Of those that change a mean, with their final numbers.
    dropped : sequence of Named
        What was looked at and may not be named.
    """
    if not before.something and not effects:
        return "NONE" if before.nothing and _all_told(state) else "INCONCLUSIVE"
    if effects and (members or not before.something):
        return _least_sure(effects)
    joints = {e.named.member.candidate.joint for e in effects}  # of effects on noise, which say what is odd there
    elsewhere = np.array([c.joint not in joints for c in laid.bench.scene.channels])
    left = smooth_nats(view_of(state, laid.tests, laid.inputs), members, elsewhere)
    names = {c.name for c, other in zip(laid.bench.scene.channels, elsewhere, strict=True) if other}
    if left > penalty(max(state.n_kinds, 1)) or is_plain(before, names, dropped):
        return "UNKNOWN"
    return _least_sure(effects) if effects else "INCONCLUSIVE"


def _all_told(state: Search) -> bool:
    """Whether neither rare moments nor the tolerance of the arm's table can hide what is missing."""
    bench, noises = state.bench, state.lens.noises
    small = all(share <= MOST_TOLERATED for share in tolerated(bench, noises).values())
    return small and not bursts_of(bench, noises)


def is_plain(before: Localisation, channels: Set[str], dropped: Sequence[Named]) -> bool:
    """Whether one of these channels plainly differs, as far as it matters, and the catalogue has hardly a word for it.

    The smooth model may miss what comes and goes: small tests see it all the same. Effects that were dropped because
    they are but a part of something else are no word for it.
    """
    matters = {e.channel for e in before.equivalence if not e.shown}
    found = [f.nats for f in before.findings if f.counts and f.channel in channels & matters]
    said = max((n.nats for n in dropped if n.level != "UNKNOWN"), default=0.0)
    return max(found, default=0.0) > max(PLAIN * before.threshold, said / SAID)


def _least_sure(effects: Sequence[NamedEffect]) -> Level:
    return ORDER[max(ORDER.index(e.named.level) for e in effects)]  # kept effects have one of these
