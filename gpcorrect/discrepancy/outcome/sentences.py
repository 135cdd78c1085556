"""The verdict in sentences, and what to do now in another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import Burst
from gpcorrect.discrepancy.evidence.variables import Quantity
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.outcome.result import ChannelGap, DiscrepancyResult, NamedEffect
from gpcorrect.discrepancy.outcome.words import (
    channel_words,
    estimate_words,
    in_reader_units,
    number,
    place,
    region_words,
)
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.discrepancy.settings import NOISE, TESTS, VERDICT
from gpcorrect.sim.effects import Family

TOLERANCES = (
    f"tolerances of table and registration ({1e3 * NOISE.table_angle:.1g} mrad, {1e3 * NOISE.table_length:.1g} mm)"
)
NOT_COMPARED = "loads, friction and gains in the servo loop are not compared (the remarks say why)"
VISIBLE = 1.15  # of the noise: a residual below shows nothing
ALTERNATIVES = 3  # names for one thing, its own among them
LONG_UNIT = 8  # letters, beyond which a number is left to the table
SHOWN = 3  # places in the sentence, and numbers of an effect; what is elsewhere is counted


def next_step(result: DiscrepancyResult) -> str:
    """Return what to do now, in one sentence.

    Parameters
    ----------
    result : DiscrepancyResult
    """
    found = result.localisation.findings
    # While something is unknown, the name of a smaller part can wait.
    experiment = None if result.level == Level.UNKNOWN else result.next_experiment
    if experiment is not None and not experiment.decisive:
        return f"{' and '.join(experiment.separates)} are {experiment.run}"
    if experiment is not None:
        return f"record: {experiment.run} ({experiment.minutes:.0f} min), to tell {' from '.join(experiment.separates)}"
    match result.level:
        case Level.NONE:
            apart = f"; {NOT_COMPARED}" if result.provenance.servo_unseen else ""
            return f"stop looking{_behind(result)}: the model is as good as these sensors can tell{apart}"
        case Level.EXACT:
            return "use model.toml, for simulation and for the next run"
        case Level.UNKNOWN:
            return _next_of_unknown(result)
        case _ if not found and _tolerated(result) > VERDICT.most_tolerated:
            return "calibrate the table, or leave T_tracker_base out of the model: then it is registered from the data"
        case _ if result.provenance.bursts and not found:
            return "record more motions like those in which it happens: a name must hold on motions not seen"
        case _:
            return "record more trajectories, or with another outside sensor"


def _next_of_unknown(result: DiscrepancyResult) -> str:
    found = result.localisation.findings
    if _unfitted(result) is not None:
        return "run it again with another --seed: it deals other motions to the parts that effects are fitted to"
    if found and [s.variable.quantity for s in found[0].region] == [Quantity.FREQUENCY]:
        return "find what shakes at that frequency, whatever the arm does: a pump, a fan, the floor"
    if found and any(span.variable.quantity == Quantity.SESSION for span in found[0].region):
        moved = "" if found[0].channel.signal == "measured_jp" else "tracker or base moved, "
        return f"run each session by itself, and look at what changed between them: {moved}homing, tool, load"
    if result.provenance.bursts and not found:
        return "look at the machine in motions like those in which it happens, and record more of them"
    if any(not e.is_constant for e in result.verdict.alike):
        return "look for what changes it from motion to motion: load, heat, wear, speed, the way it came"
    return "look at the machine where the maps below are dark; no effect of the catalogue acts like that"


def closed_by(gaps: Sequence[ChannelGap], joint: int | str | None = None) -> ChannelGap | None:
    """Return the channel that had the largest gap over its noise, of those where it is known how much of it is closed.

    Channels in which it narrows come first, and of these outside sensors: motor encoders see the transmission only
    through the servo's tiny answer to the load.

    Parameters
    ----------
    gaps : sequence of ChannelGap
    joint : int, str or None, only channels of this joint, where it has any
    """
    known = [g for g in gaps if np.isfinite(g.closed) and g.noise]
    chosen = [g for g in known if isinstance(joint, int) and g.channel.joint == joint] or known
    chosen = [g for g in chosen if g.narrows] or chosen
    outside = [g for g in chosen if g.channel.signal != "measured_jp" and g.before > VISIBLE * g.noise]
    return max(outside or chosen, key=_excess, default=None)


def _excess(gap: ChannelGap | None) -> float:
    return 0.0 if gap is None else gap.before / gap.noise


def verdict_sentences(result: DiscrepancyResult) -> list[str]:
    """Return the verdict: first what matters most and how much of the gap it closes, then what is beside it.

    Parameters
    ----------
    result : DiscrepancyResult
    """
    if result.level == Level.NONE:
        return [_nothing(result)]
    if result.level == Level.INCONCLUSIVE and not result.effects:
        return [_undecided(result)]
    named = _by_place(result)
    if result.level != Level.UNKNOWN:
        rare = [
            f"moments far above the noise stay unexplained: {_burst_words(burst)}"
            for burst in result.provenance.bursts[:1]
        ]
        return [f"{words[:1].upper()}{words[1:]}." for words in (named[0], "; ".join([*named[1:], *rare])) if words]
    unknown = [f"Something outside the catalogue is missing{_where(result)}.", *_alike_words(result)]
    return [*unknown, f"Beside it, {'; '.join(named)}."] if result.effects else unknown


def _alike_words(result: DiscrepancyResult) -> list[str]:
    """Return what the machine acts like without being it, in a sentence of its own, if there is anything."""
    alike = [e for e in result.verdict.alike if not e.is_minor]
    if not alike:
        return []
    but = []
    if spreads := [e.spread for e in alike if not e.is_constant]:
        but.append(f"by another size in every motion (up to {_percent(max(spreads))})")
    if parts := [e.closes for e in alike if not e.is_whole]:
        but.append(f"closes only {_percent(max(0.0, min(parts)))} of the gap")
    return [f"It acts like {_listed(alike, sized=False)}, but {' and '.join(but)}."]


def _by_place(result: DiscrepancyResult) -> list[str]:
    """Effects of each place, the one with the largest gap over its noise first, and how many are not spoken of."""
    groups: dict[int | str, list[NamedEffect]] = {}
    for effect in result.effects:
        groups.setdefault(effect.joint, []).append(effect)
    gaps = {where: closed_by(result.gap, where) for where in groups}
    order = sorted(groups, key=lambda where: -_excess(gaps[where]))
    words = [_group_words(groups[where], gaps[where]) for where in order[:SHOWN]]
    others = sum(len(groups[where]) for where in order[SHOWN:])
    if others:
        words.append(f"and {others} smaller elsewhere")
    if minor := len(result.verdict.minor):
        words.append(f"{minor} below {_percent(TESTS.equivalence)} of the noise, listed as minor")
    if result.verdict.of_steps:
        words.append(f"{steps_words(result)}: no more than how two programs step a servo")
    return words


def steps_words(result: DiscrepancyResult) -> str:
    """Return what is but a matter of the servo's steps, and where, or nothing.

    Parameters
    ----------
    result : DiscrepancyResult
    """
    return _listed(result.verdict.of_steps)


def _listed(effects: Sequence[NamedEffect], *, sized: bool = True) -> str:
    names = [f"{_named(e, interval=False, sized=sized)} ({place(e.joint)})" for e in effects[:SHOWN]]
    more = len(effects) - len(names)
    return " + ".join(names) + (f" and {more} more" if more else "")


def _group_words(effects: Sequence[NamedEffect], gap: ChannelGap | None) -> str:
    where = place(effects[0].joint).removeprefix("the ")
    shown = None if gap is None or gap.before < VISIBLE * gap.noise else gap
    fraction = f"{_percent(min(shown.closed, 1.0))} of the gap" if shown else ""
    if all(e.family == Family.NOISE for e in effects):
        return f"{where}: {' + '.join(_named(e, interval=len(effects) == 1) for e in effects)}, noise: no gap to close"
    if len(effects) == 1:
        (effect,) = effects
        words = _named(effect, interval=True) if effect.level == Level.EXACT else _either(effect)
        kind = f"a {effect.family} effect, " if effect.level == Level.CLASS else ""
        return f"{where}: {kind}{words}" + (f", closes {fraction}" if fraction else "")
    names = " + ".join(map(short_words, effects))
    return f"{where}: {names}, close {fraction}" if fraction else f"{where}: {names}"


def _named(effect: NamedEffect, *, interval: bool, sized: bool = True) -> str:
    sizes = _sizes(effect) if sized else []
    source = [f" from joint {e.value}" for name, e in effect.parameters.items() if name == "source"]
    name = f"{effect.name.replace('_', ' ')}{''.join(source)}"
    if not sizes:
        return name
    if len(sizes) == 1:
        return f"{name}{',' if interval else ''} {estimate_words(sizes[0], interval=interval)}"
    called = {id(e): n for n, e in effect.parameters.items()}
    beside = [e for e in sizes[1:] if e.is_clear][: SHOWN - 1] if interval else []
    words = [f"{called[id(e)]} {estimate_words(e, interval=e is sizes[0] and interval)}" for e in (sizes[0], *beside)]
    return f"{name}{',' if interval else ''} {', '.join(words)}"


def _sizes(effect: NamedEffect) -> list[Estimate]:
    """Numbers that were estimated, those whose interval keeps clear of nothing first."""
    sizes = sorted((e for e in effect.parameters.values() if e.ci95 is not None), key=lambda e: not e.is_clear)
    return sizes if len(sizes) == 1 or any(e.is_clear for e in sizes) else []  # bounds of each say nothing of them all


def short_words(effect: NamedEffect) -> str:
    """Return one of several effects of a place: its number only where that is short, rivals without probabilities.

    Parameters
    ----------
    effect : NamedEffect
    """
    if effect.level != Level.EXACT:
        return _either(effect, chances=False)
    sizes = _sizes(effect)
    long = bool(sizes) and len(in_reader_units(0.0, sizes[0].unit)[1]) > LONG_UNIT
    return _named(effect, interval=False, sized=not long)


def _either(effect: NamedEffect, *, chances: bool = True) -> str:
    """Return an effect and up to two rivals, the most probable first; those of one name by what they differ in."""
    names = [(effect.probability, effect.name.replace("_", " "))]
    for rival in effect.rivals:
        where = "" if rival.joint == effect.joint else f" of {place(rival.joint)}"
        names.append((rival.probability, f"{rival.name.replace('_', ' ')}{where}"))
    if len({name for _, name in names}) < len(names):
        labels = (effect.label, *(rival.label for rival in effect.rivals))
        names = [(chance, label) for (chance, _), label in zip(names, labels, strict=True)]
    names.sort(key=lambda entry: -entry[0])
    return " or ".join(f"{name} ({_percent(chance)})" if chances else name for chance, name in names[:ALTERNATIVES])


def _nothing(result: DiscrepancyResult) -> str:
    left, steps = result.remainder or result.localisation, result.verdict.of_steps
    bounds = [e.upper for e in left.equivalence if np.isfinite(e.upper)]
    rest = f"; what could still hide is below {100 * max(bounds):.0f} % of the noise" if bounds else ""
    seen = ""
    for faint in left.findings[:1]:  # no finding of these counts, or the verdict would be another
        size = f"{100 * faint.size:.0f} % of it"
        seen = f"; {channel_words(faint.channel)} differs by {size}, too little to matter"
    tolerated = _tolerated(result)
    beyond = f" and {TOLERANCES} ({100 * tolerated:.0f} % of it)" if tolerated > TESTS.equivalence else ""
    numbers = steps_words(result) if len(steps) == 1 else f"{len(steps)} numbers in the model"
    stepped = f" and how each steps its servos ({numbers})" if steps else ""
    return (
        f"Nothing is missing{_behind(result)}: simulation and recording agree up to noise{beyond}{stepped}{rest}{seen}."
    )


def _behind(result: DiscrepancyResult) -> str:
    return " behind the motors" if result.provenance.servo_unseen else ""


def _undecided(result: DiscrepancyResult) -> str:
    if any(f.counts for f in result.localisation.findings):
        where = _where(result)
        return f"Not decided: simulation and recording differ{where}, but no name can be given from these data."
    if bursts := result.provenance.bursts:
        return f"Not decided: something happens in the {_burst_words(bursts[0])}, too rarely for a name."
    if (tolerated := _tolerated(result)) > VERDICT.most_tolerated:
        return (
            f"Not decided: what differs can be put down to {TOLERANCES}, but it is {100 * tolerated:.0f} % of the "
            "noise: something else may hide in it."
        )
    return "Not decided: nothing beats noise, but these data are too few or too noisy to show that nothing is missing."


def _tolerated(result: DiscrepancyResult) -> float:
    return max(result.provenance.tolerated.values(), default=0.0)


def _burst_words(burst: Burst) -> str:
    """Return where a burst is, how large, and in which trajectories."""
    (size, unit), (noise, _) = (in_reader_units(v, burst.channel.unit) for v in (burst.largest, burst.noise))
    shown = burst.trajectories[:SHOWN]
    numbers = f"trajectories {', '.join(map(str, shown))}" if len(burst.trajectories) > 1 else f"trajectory {shown[0]}"
    more = " and others" if len(burst.trajectories) > SHOWN else ""
    largest = f"up to {number(size)} {unit} in {numbers}{more}; noise {number(noise)} {unit}"
    return f"{channel_words(burst.channel)} ({largest})"


def _where(result: DiscrepancyResult) -> str:
    unfitted = _unfitted(result)
    if unfitted is not None:
        return f": {channel_words(unfitted.channel)}, in motions of the test set alone"
    left = () if result.remainder is None else result.remainder.findings
    unknown = _first_unknown(result)
    there = [f for f in left if (f.channel.joint or "tool") == unknown]
    for finding in (there or left or result.localisation.findings)[:1]:
        return f": {channel_words(finding.channel)}, most at {region_words(finding.region)}"
    for burst in result.provenance.bursts[:1]:
        return f", and {'happens rarely' if burst.rare else 'comes and goes'}: {_burst_words(burst)}"
    return ""


def _first_unknown(result: DiscrepancyResult) -> int | str | None:
    """Return the place with the largest unknown rest, if there is one."""
    return next((v.place for v in result.verdict.places if v.level == Level.UNKNOWN), None)


def _unfitted(result: DiscrepancyResult) -> ChannelGap | None:
    """Return the channel at that place that is off in the test set, if nothing is found there in the other parts."""
    place = _first_unknown(result)
    found = (result.remainder or result.localisation).findings
    if any((f.channel.joint or "tool") == place for f in found):
        return None
    off = [g for g in result.gap if (g.channel.joint or "tool") == place and g.is_beyond_chance]
    return max(off, key=lambda g: g.after / g.noise, default=None)


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %" if np.isfinite(fraction) else "–"
