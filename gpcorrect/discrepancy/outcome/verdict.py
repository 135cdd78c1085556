"""The verdict: nothing, names, something unknown, or not enough to say."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import Burst, bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.naming.posterior import SURENESS, Level, Named
from gpcorrect.discrepancy.naming.smooth_model import smooth_columns, smooth_nats
from gpcorrect.discrepancy.outcome.result import ChannelGap, NamedEffect, PlaceVerdict
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search, penalty, view_of
from gpcorrect.discrepancy.settings import TESTS, VERDICT


def verdict_level(
    prepared: PreparedData,
    state: Search,
    before: Localisation,
    effects: Sequence[NamedEffect],
    alike: Sequence[NamedEffect],
    fitted: Sequence[FittedEffect],
    dropped: Sequence[Named],
) -> Level:
    """Return what a run comes to.

    Parameters
    ----------
    prepared : PreparedData
    state : Search, after the naming
    before : Localisation, of the nominal model's residual
    effects : sequence of NamedEffect, those that may be named, effects on noise too
    alike : sequence of NamedEffect, those that the machine only acts like
    fitted : sequence of FittedEffect, those of them that change a mean, with their final numbers
    dropped : sequence of Named, what was looked at and may not be named
    """
    dataset, noises = state.dataset, state.whitener.noises
    bursts = bursts_of(dataset, noises, [f.effect for f in fitted])
    lasting = any(b.lasts for b in bursts)
    if not before.something and not effects:
        if lasting:
            return Level.UNKNOWN
        tolerable = all(t <= VERDICT.most_tolerated for t in dataset.tolerated(noises).values())
        compared = not dataset.scene.unclocked  # else the motors were compared with nothing
        return Level.NONE if before.nothing and tolerable and compared and not bursts else Level.INCONCLUSIVE
    if alike and not effects:
        return Level.UNKNOWN
    if effects and (fitted or not before.something):
        return _least_sure(effects)
    joints = {e.joint for e in effects}  # of effects on noise, which say what is odd there
    if any(e.half_count for e in effects):
        joints.add(0)  # a tracker sees what rounding does to the joint
    elsewhere = np.array([c.joint not in joints for c in dataset.scene.channels])
    channels = {c for c in dataset.scene.channels if c.joint not in joints}
    view = view_of(state, prepared)
    each = np.eye(len(elsewhere), dtype=np.bool_)[elsewhere]  # all at once, six joints ask for gigabytes
    left = sum(smooth_nats(view, fitted, only, smooth_columns(view, fitted, only)) for only in each)
    if left > penalty(state.n_kinds) or is_plain(before, channels, dropped) or lasting:
        return Level.UNKNOWN
    return _least_sure(effects) if effects else Level.INCONCLUSIVE


def is_plain(before: Localisation, channels: Set[Channel], dropped: Sequence[Named]) -> bool:
    """Return whether a channel differs beyond doubt, as far as it matters, and the catalogue explains hardly any of it.

    The smooth model may miss what comes and goes: small tests see it all the same. Effects that were dropped because
    they are but a part of something else explain nothing.

    Parameters
    ----------
    before : Localisation, of the nominal model's residual
    channels : set of Channel, those that may count
    dropped : sequence of Named, what was looked at and may not be named
    """
    matters = {e.channel for e in before.equivalence if not e.shown}
    found = [f.nats for f in before.findings if f.counts and f.channel in channels & matters]
    explained = max((n.nats for n in dropped if n.level != Level.UNKNOWN), default=0.0)
    return max(found, default=0.0) > max(VERDICT.plain * before.threshold, explained / VERDICT.explained)


def closed_where_they_show(
    state: Search, fitted: Sequence[FittedEffect], gaps: Sequence[ChannelGap], left: Localisation
) -> list[float]:
    """Return for each effect which part of the gap all of them close where it shows; 1 where the rest may be noise.

    Every channel counts by the square of what the effect changes there beside the noise. Effects that show in common
    channels share the least of theirs: together they are fitted to what one of them does not explain.

    Parameters
    ----------
    state : Search, after the naming
    fitted : sequence of FittedEffect, all that are in the model
    gaps : sequence of ChannelGap, of every channel, in the scene's order
    left : Localisation, of the residual that they leave
    """
    limit = VERDICT.plain * left.threshold
    plain = {f.channel for f in left.findings if f.counts and f.size > TESTS.equivalence and f.nats > limit}
    closed = np.array([min(np.nan_to_num(g.closed), 1.0) if g.channel in plain else 1.0 for g in gaps])
    noise, signatures = np.array([g.noise for g in gaps]), state.dataset.changes([f.effect for f in fitted])
    changes = np.nanmean(signatures**2, axis=0).T / noise**2
    own = [float(change @ closed / change.sum()) if change.any() else 1.0 for change in changes]
    return [min(c for g, c in zip(fitted, own, strict=True) if state.alike(f.candidate, g.candidate)) for f in fitted]


def place_verdicts(
    effects: Sequence[NamedEffect],
    gaps: Sequence[ChannelGap],
    left: Localisation,
    bursts: Sequence[Burst] = (),
    alike: Sequence[NamedEffect] = (),
) -> tuple[PlaceVerdict, ...]:
    """Return what a run comes to at each joint, and at the tool where a tracker sees it; the largest rest first.

    Parameters
    ----------
    effects : sequence of NamedEffect, of the verdict
    gaps : sequence of ChannelGap, of every channel
    left : Localisation, of the residual that the named effects leave
    bursts : sequence of Burst, of the same
    alike : sequence of NamedEffect, those that the machine only acts like: where one matters, something is unknown
    """
    acting = [e for e in (*effects, *alike) if isinstance(e.joint, int)]
    every = {g.channel.joint or "tool" for g in gaps} | {e.joint for e in acting}
    found = [_place_verdict(place, effects, gaps, left, bursts, alike) for place in sorted(every, key=str)]
    return tuple(sorted(found, key=lambda v: (-v.remaining, str(v.place))))


def _place_verdict(
    place: int | str,
    effects: Sequence[NamedEffect],
    gaps: Sequence[ChannelGap],
    left: Localisation,
    bursts: Sequence[Burst],
    alike: Sequence[NamedEffect],
) -> PlaceVerdict:
    own = [g for g in gaps if (g.channel.joint or "tool") == place]
    here, like = (tuple(e for e in some if _acts_at(e, place)) for some in (effects, alike))
    seen = own or [g for g in gaps if not g.channel.joint]  # joints that a tracker alone sees
    if here:  # where what they close shows, such as a table error in a tracker
        seen = [g for g in own if g.narrows] or [g for g in gaps if g.narrows] or seen
    worst = max(seen, key=lambda g: (np.nan_to_num(g.before) / g.noise, g.channel.signal != "measured_jp"))
    rounded = max((e.half_count for e in here), default=0.0)
    allowed = {g.channel: rounded / g.noise for g in own}
    channels = set(allowed)
    findings = [f for f in left.findings if f.counts and f.channel in channels and f.size > allowed[f.channel]]
    plain = [f for f in findings if f.nats > VERDICT.plain * left.threshold]
    squares = [(np.nan_to_num(g.after) ** 2 - rounded**2) / g.noise**2 for g in own]
    rests = [np.sqrt(max(square - 1.0, 0.0)) for square in squares]
    remaining = float(max([*rests, *(f.size for f in plain)], default=0.0))
    rare = [b for b in bursts if b.channel in channels]
    if (
        any(b.lasts for b in rare)
        or any(not e.is_minor for e in like)
        or ((findings or any(g.is_beyond_chance for g in own)) and remaining > VERDICT.rest)
        or (plain and not here)
    ):
        level = Level.UNKNOWN
    elif here:
        level = _least_sure(here)
    else:
        shown = not findings and not rare and all(e.shown for e in left.equivalence if e.channel in channels)
        level = Level.NONE if shown else Level.INCONCLUSIVE
    return PlaceVerdict(place, level, worst, remaining, here, like)


def _acts_at(effect: NamedEffect, place: int | str) -> bool:
    if effect.joint == "all":  # at the tool too, unless it is the motors that it changes
        return place != "tool" or not effect.of_motor
    return place in (effect.joint, "tool" if effect.joint == "base" else effect.joint)


def headline(
    level: Level, effects: Sequence[NamedEffect], alike: Sequence[NamedEffect], places: Sequence[PlaceVerdict]
) -> Level:
    """Return the level of the whole, led by what matters most.

    A name is no headline while more than the noise is left without one elsewhere, nor are effects too small to matter
    while anything larger is undecided.

    Parameters
    ----------
    level : Level, by the named effects alone
    effects, alike : sequences of NamedEffect, of the verdict
    places : sequence of PlaceVerdict, of every place
    """
    unknown = [v for v in places if v.level == Level.UNKNOWN]
    if level not in SURENESS:
        return Level.UNKNOWN if unknown else level
    large = [e for e in effects if not e.is_minor]
    acts_like = any(not e.is_minor for e in alike)
    if acts_like or any(v.remaining > VERDICT.rest for v in unknown) or (unknown and not large):
        return Level.UNKNOWN
    return _least_sure(large or effects)


def _least_sure(effects: Sequence[NamedEffect]) -> Level:
    return SURENESS[max(SURENESS.index(e.level) for e in effects)]  # named effects have one of these
