"""English for results, in one place: the verdict in one sentence, and numbers in the units that people read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.variables import Quantity, Span, Variable
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.outcome.result import Burst, ChannelGap, DiscrepancyResult, NamedEffect
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.noise import ChannelNoise, NoiseSource
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.discrepancy.settings import NOISE, TESTS, VERDICT
from gpcorrect.sim.effects import Family

__all__ = [
    "MEANING",
    "VISIBLE",
    "Closed",
    "channel_words",
    "closed_by",
    "estimate_words",
    "in_reader_units",
    "next_step",
    "noise_source_words",
    "number",
    "place",
    "region_words",
    "variable_words",
    "verdict_sentence",
]

READER_UNITS = {
    "rad": ("°", 180.0 / np.pi),
    "m": ("mm", 1e3),
    "rad/s": ("°/s", 180.0 / np.pi),
    "m/s": ("mm/s", 1e3),
    "rad/s^2": ("°/s²", 180.0 / np.pi),
    "m/s^2": ("mm/s²", 1e3),
    "1": ("", 1.0),
    "rad per unit of source": ("rad for each rad (or m) of that joint", 1.0),
    "m per unit of source": ("m for each m (or rad) of that joint", 1.0),
}
MEANING = {
    Level.NONE: "nothing that matters beats noise, and what could still hide is shown to be too small to matter",
    Level.EXACT: "one name holds, on trajectories that the search had not seen, and no rival is left",
    Level.CLASS: "the kind of effect is sure, which one of its kind is not",
    Level.SET: "one of those listed is there; these data do not tell which",
    Level.UNKNOWN: "something real that no effect of the catalogue explains",
    Level.INCONCLUSIVE: "too little data, or nothing held on trajectories that the search had not seen",
}
NOISE_SOURCES = {
    NoiseSource.STATED: "[noise] of the model file",
    NoiseSource.HOLDS: "holds",
    NoiseSource.SHORT_LAGS: "changes over short lags (assumes that motion effects are smoother)",
    NoiseSource.TOO_FEW: "too few samples; the smallest noise is assumed",
}
TOLERANCES = (
    f"tolerances of table and registration ({1e3 * NOISE.table_angle:.1g} mrad, {1e3 * NOISE.table_length:.1g} mm)"
)
VISIBLE = 1.15  # of the noise: a residual below shows nothing
ALTERNATIVES = 3  # names for one thing, its own among them
LONG_UNIT = 8  # letters, beyond which a number is left to the table
SHOWN = 3  # places in the sentence; what is elsewhere is counted


def in_reader_units(value: float, unit: str) -> tuple[float, str]:
    """Return a value as people read it, with its unit: degrees and millimetres; other units stay.

    Parameters
    ----------
    value : float
        SI.
    unit : str
        Its unit.
    """
    shown, factor = READER_UNITS.get(unit, (unit, 1.0))
    return factor * value, shown


def number(value: float) -> str:
    """Return three significant digits without an exponent where that is short; a dash for no number.

    Parameters
    ----------
    value : float
        NaN is no number.
    """
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    digits = int(np.clip(2 - np.floor(np.log10(abs(value))), 0, 9))
    text = f"{value:.{digits}f}"
    return text if 1e-4 <= abs(value) < 1e6 else f"{value:.2e}"


def region_words(spans: Sequence[Span]) -> str:
    """Return where a residual is largest: "joint 2 moving back, load of joint 1 from 1 to 2 N m".

    Parameters
    ----------
    spans : sequence of Span
        Of a cell.
    """
    return ", ".join(_span_words(span) for span in spans)


def _span_words(span: Span) -> str:
    match span.variable.quantity:
        case Quantity.DIRECTION:
            moving = {-1.0: "moving back", 1.0: "moving forward"}.get(span.low, "before its first move")
            return f"joint {span.variable.joint} {moving}"
        case Quantity.FREQUENCY:
            return f"a tone between {number(span.low)} and {number(span.high)} {span.unit}"
        case Quantity.SESSION:
            return f"session {span.low + 1:.0f}"
    name = variable_words(span.variable)
    low, symbol = in_reader_units(span.low, span.unit)
    high, _ = in_reader_units(span.high, span.unit)
    gap = "" if symbol == "°" else " "
    if span.low == span.high:
        return f"{name} at {number(low)}{gap}{symbol}".rstrip()
    return f"{name} from {number(low)} to {number(high)}{gap}{symbol}".rstrip()


def variable_words(variable: Variable) -> str:
    """Return a variable's name: "position of joint 2".

    Parameters
    ----------
    variable : Variable
        Of a test.
    """
    return str(variable.quantity) if variable.joint is None else f"{variable.quantity} of joint {variable.joint}"


def place(joint: int | str | None) -> str:
    """Return where an effect sits: "joint 2", "the tool", "the base", "all joints".

    Parameters
    ----------
    joint : int, str or None
        As effects have it.
    """
    if isinstance(joint, int):
        return f"joint {joint}"
    return {"tool": "the tool", "base": "the base", "all": "all joints"}.get(str(joint), str(joint))


def channel_words(channel: Channel) -> str:
    """Return a channel's name: "outside sensor of joint 2", "tracker x".

    Parameters
    ----------
    channel : Channel
        Of a recording.
    """
    signals = {
        "external_jp": "outside sensor of joint",
        "measured_jp": "motor encoder of joint",
        "tracker_rotation": "tracker's turn about",
    }
    kind = signals.get(channel.signal, "tracker")
    return f"{kind} {channel.joint or 'xyz'[channel.index]}"


def noise_source_words(noise: ChannelNoise) -> str:
    """Return what a channel's noise was taken from.

    Parameters
    ----------
    noise : ChannelNoise
        Of the channel.
    """
    words = NOISE_SOURCES[noise.source]
    words += "" if noise.rounding_step is None else f"; rounded to {noise.rounding_step:.2g}"
    return words + ("" if noise.times_stated is None else f"; {noise.times_stated:.2g} times what [noise] states")


def estimate_words(estimate: Estimate, *, interval: bool = True) -> str:
    """Return a parameter, such as "118 N m/rad (105 to 131)"; sessions separated by semicolons.

    Parameters
    ----------
    estimate : Estimate
        The parameter.
    interval : bool
        Whether its 95 % interval is shown.
    """
    value, ci95, unit = estimate.value, estimate.ci95, estimate.unit
    values = value if isinstance(value, tuple) else (value,)
    if not unit and ci95 is None:
        return ", ".join(str(v) for v in values)
    intervals: Sequence[object] = [None] * len(values)
    if interval and ci95 is not None:
        intervals = ci95 if isinstance(value, tuple) else [ci95]
    return "; ".join(_one(v, c, unit) for v, c in zip(values, intervals, strict=True))


def _one(value: float | str, interval: object, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    shown, symbol = in_reader_units(value, unit)
    gap = "" if symbol == "°" else " "
    text = f"{number(shown)}{gap}{symbol}".strip()
    if not isinstance(interval, tuple):
        return text
    low, high = (number(in_reader_units(float(end), unit)[0]) for end in interval)
    return f"{text} ({low} to {high})"


def next_step(result: DiscrepancyResult) -> str:
    """Return what to do now, in one sentence.

    Parameters
    ----------
    result : DiscrepancyResult
        Of a run.
    """
    experiment, found = result.next_experiment, result.localisation.findings
    if experiment is not None and not experiment.decisive:
        return f"{' and '.join(experiment.separates)} are {experiment.run}"
    if experiment is not None:
        return f"record: {experiment.run} ({experiment.minutes:.0f} min), to tell {' from '.join(experiment.separates)}"
    match result.level:
        case Level.NONE:
            return "stop looking: the model is as good as these sensors can tell"
        case Level.EXACT:
            return "use model.toml, for simulation and for the next run"
        case Level.UNKNOWN if found and found[0].variables == (Variable(Quantity.FREQUENCY),):
            return "find what shakes at that frequency, whatever the arm does: a pump, a fan, the floor"
        case Level.UNKNOWN:
            return "look at the machine where the maps below are dark; no effect of the catalogue acts like that"
        case _ if not found and _tolerated(result) > VERDICT.most_tolerated:
            return "calibrate the table, or leave T_tracker_base out of the model: then it is registered from the data"
        case _ if result.provenance.bursts and not found:
            return "record more motions like those in which it happens: a name must hold on motions not seen"
        case _:
            return "record more trajectories, or with another outside sensor"


@dataclass(frozen=True)
class Closed:
    """The channel with the largest gap of some, the fraction of it that is closed, and its size over the noise."""

    channel: Channel
    fraction: float
    excess: float


def closed_by(gaps: Sequence[ChannelGap], joint: int | str | None = None) -> Closed | None:
    """Return the channel that had the largest gap over its noise, and how much of it is closed.

    Outside sensors come first: motor encoders see the transmission only through the servo's tiny answer to the load.

    Parameters
    ----------
    gaps : sequence of ChannelGap
        Of a result.
    joint : int, str or None
        Only channels of this joint, where it has any.
    """
    known = [g for g in gaps if np.isfinite(g.closed) and g.noise]
    chosen = [g for g in known if isinstance(joint, int) and g.channel.joint == joint] or known
    outside = [g for g in chosen if g.channel.signal != "measured_jp" and g.before > VISIBLE * g.noise]
    found = [Closed(g.channel, g.closed, g.before / g.noise) for g in outside or chosen]
    return max(found, key=lambda c: c.excess, default=None)


def verdict_sentence(result: DiscrepancyResult) -> str:
    """Return the verdict in one sentence: what is missing, how much, and how much of the gap it closes.

    Parameters
    ----------
    result : DiscrepancyResult
        Of a run.
    """
    if result.level == Level.NONE:
        return _nothing(result)
    if result.level == Level.INCONCLUSIVE and not result.effects:
        return _undecided(result)
    named = _by_place(result)
    if result.level != Level.UNKNOWN:
        return f"{named}."
    unknown = f"Something outside the catalogue is missing{_where(result)}"
    return f"{unknown}." if not result.effects else f"{unknown}. Beside it, {named[:1].lower()}{named[1:]}."


def _by_place(result: DiscrepancyResult) -> str:
    """Effects one place after the other, the one with the largest gap over its noise first."""
    groups: dict[int | str, list[NamedEffect]] = {}
    for effect in result.effects:
        groups.setdefault(effect.joint, []).append(effect)
    sizes = {where: closed_by(result.gap, where) for where in groups}
    excess = {where: 0.0 if size is None else size.excess for where, size in sizes.items()}
    order = sorted(groups, key=lambda where: -excess[where])
    words = [_group_words(groups[where], sizes[where]) for where in order[:SHOWN]]
    others = sum(len(groups[where]) for where in order[SHOWN:])
    minor = len(result.verdict.minor)
    less = f"; {minor} below {_percent(TESTS.equivalence)} of the noise, listed as minor" if minor else ""
    return "; ".join(words) + (f"; and {others} smaller elsewhere" if others else "") + less


def _group_words(effects: Sequence[NamedEffect], closed: Closed | None) -> str:
    where = place(effects[0].joint).removeprefix("the ").capitalize()
    fraction = "" if closed is None else f"{_percent(min(closed.fraction, 1.0))} of the gap"
    if all(e.family == Family.NOISE for e in effects):
        return f"{where}: {' + '.join(_named(e, interval=len(effects) == 1) for e in effects)}, noise: no gap to close"
    if len(effects) == 1:
        return f"{where}: {_effect_words(effects[0])}" + (f", closes {fraction}" if fraction else "")
    names = " + ".join(map(_short, effects))
    return f"{where}: {names}, close {fraction}" if fraction else f"{where}: {names}"


def _effect_words(effect: NamedEffect) -> str:
    """Return an effect with its first number and its interval; rivals that remain are named with it."""
    match effect.level:
        case Level.EXACT:
            return _named(effect, interval=True)
        case Level.CLASS:
            return f"a {effect.family} effect, {_either(effect)}"
        case _:
            return _either(effect)


def _named(effect: NamedEffect, *, interval: bool, sized: bool = True) -> str:
    sizes = [e for e in effect.parameters.values() if e.ci95 is not None and sized]
    source = [f" from joint {e.value}" for name, e in effect.parameters.items() if name == "source"]
    name = f"{effect.name.replace('_', ' ')}{''.join(source)}"
    if not sizes:
        return name
    return f"{name}{',' if interval else ''} {estimate_words(sizes[0], interval=interval)}"


def _short(effect: NamedEffect) -> str:
    """Return one of several effects of a place: its number only where that is short, rivals without probabilities."""
    if effect.level != Level.EXACT:
        return _either(effect, chances=False)
    sizes = [e for e in effect.parameters.values() if e.ci95 is not None]
    long = bool(sizes) and len(in_reader_units(0.0, sizes[0].unit)[1]) > LONG_UNIT
    return _named(effect, interval=False, sized=not long)


def _either(effect: NamedEffect, *, chances: bool = True) -> str:
    """Return an effect and up to two rivals, the most probable first."""
    names = [(effect.probability, effect.name.replace("_", " "))]
    for rival in effect.rivals:
        where = "" if rival.joint == effect.joint else f" of {place(rival.joint)}"
        names.append((rival.probability, f"{rival.name.replace('_', ' ')}{where}"))
    names.sort(key=lambda entry: -entry[0])
    return " or ".join(f"{name} ({_percent(chance)})" if chances else name for chance, name in names[:ALTERNATIVES])


def _nothing(result: DiscrepancyResult) -> str:
    bounds = [e.upper for e in (result.remainder or result.localisation).equivalence if np.isfinite(e.upper)]
    rest = f"; what could still hide is below {100 * max(bounds):.0f} % of the noise" if bounds else ""
    seen = ""
    for faint in result.localisation.findings[:1]:  # no finding of these counts, or the verdict would be another
        size = f"{100 * faint.size:.0f} % of it"
        seen = f"; {channel_words(faint.channel)} differs by {size}, too little to matter"
    tolerated = _tolerated(result)
    beyond = f" and {TOLERANCES} ({100 * tolerated:.0f} % of it)" if tolerated > TESTS.equivalence else ""
    return f"Nothing is missing: simulation and recording agree up to noise{beyond}{rest}{seen}."


def _undecided(result: DiscrepancyResult) -> str:
    if any(f.counts for f in result.localisation.findings):
        where = _where(result)
        return f"Not decided: simulation and recording differ{where}, but no name can be given from these data."
    if bursts := result.provenance.bursts:
        return f"Not decided: something rare happens in the {_burst_words(bursts[0])}, too rarely for a name."
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
    left = () if result.remainder is None else result.remainder.findings
    unknown = [v.place for v in result.verdict.places if v.level == Level.UNKNOWN]
    there = [f for f in left if (f.channel.joint or "tool") in unknown[:1]]
    for finding in (there or left or result.localisation.findings)[:1]:
        return f": {channel_words(finding.channel)}, most at {region_words(finding.region)}"
    return ""


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %" if np.isfinite(fraction) else "–"
