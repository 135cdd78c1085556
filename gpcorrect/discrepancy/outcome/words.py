"""What a report says in words: the verdict in one sentence, and numbers in the units that people read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.discrepancy.evidence.cells import Span
from gpcorrect.discrepancy.evidence.localise import EQUIVALENCE
from gpcorrect.discrepancy.evidence.tolerated import MOST_TOLERATED
from gpcorrect.discrepancy.recording.slack import ANGLE, LENGTH

__all__ = [
    "MEANING",
    "VISIBLE",
    "Closed",
    "channel_words",
    "closed_by",
    "effect_words",
    "in_reader_units",
    "next_step",
    "number",
    "parameter_words",
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
TOLERANCES = f"tolerances of table and registration ({1e3 * ANGLE:.1g} mrad, {1e3 * LENGTH:.1g} mm)"
VISIBLE = 1.15  # of the noise: a residual below shows nothing
ALTERNATIVES = 3  # names for one thing, its own among them
LONG_UNIT = 8  # letters, beyond which a number is left to the table
SHOWN = 3  # places in the sentence; what is elsewhere is counted


def in_reader_units(value: float, unit: str) -> tuple[float, str]:
    """Return a value in SI as people read it: degrees and millimetres; other units stay."""
    shown, factor = READER_UNITS.get(unit, (unit, 1.0))
    return factor * value, shown


def number(value: float | None) -> str:
    """Return three significant digits without an exponent where that is short; a dash for no number."""
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    digits = int(np.clip(2 - np.floor(np.log10(abs(value))), 0, 9))
    text = f"{value:.{digits}f}"
    return text if 1e-4 <= abs(value) < 1e6 else f"{value:.2e}"


def region_words(spans: Sequence[Span]) -> str:
    """Return where a residual is largest, as people read it: "joint 2 moving back, load of joint 1 from 1 to 2 N m"."""
    return ", ".join(_span_words(span) for span in spans)


def _span_words(span: Span) -> str:
    kind, _, joint = span.variable.rpartition(" ")
    if kind == "direction":
        return f"joint {joint} " + {-1.0: "moving back", 1.0: "moving forward"}.get(span.low, "before its first move")
    if span.variable == "frequency":
        return f"a tone between {number(span.low)} and {number(span.high)} {span.unit}"
    if span.variable == "session":
        return f"session {span.low + 1:.0f}"
    name = variable_words(span.variable)
    low, symbol = in_reader_units(span.low, span.unit)
    high, _ = in_reader_units(span.high, span.unit)
    gap = "" if symbol == "°" else " "
    if span.low == span.high:
        return f"{name} at {number(low)}{gap}{symbol}".rstrip()
    return f"{name} from {number(low)} to {number(high)}{gap}{symbol}".rstrip()


def variable_words(variable: str) -> str:
    """Return a variable's name as people say it: "position of joint 2"."""
    kind, _, joint = variable.rpartition(" ")
    return f"{kind} of joint {joint}" if joint.isdigit() else variable


def place(joint: int | str | None) -> str:
    """Return where an effect sits: "joint 2", "the tool", "the base", "all joints"."""
    if isinstance(joint, int):
        return f"joint {joint}"
    return {"tool": "the tool", "base": "the base", "all": "all joints"}.get(str(joint), str(joint))


def parameter_words(parameter: Mapping[str, Any]) -> str:
    """Return a parameter with its interval, such as "118 N m/rad (105 to 131)"; sessions separated by semicolons."""
    values, intervals, unit = parameter["value"], parameter["ci95"], parameter["unit"]
    if not isinstance(values, Sequence):
        values, intervals = [values], [intervals]
    if not unit and intervals is None:
        return ", ".join(str(v) for v in values)
    said = [_one(v, c, unit) for v, c in zip(values, intervals or [None] * len(values), strict=True)]
    return "; ".join(said)


def _value_words(parameter: Mapping[str, Any]) -> str:
    values = parameter["value"]
    shown = values if isinstance(values, Sequence) else [values]
    return "; ".join(_one(v, None, parameter["unit"]) for v in shown)


def _one(value: Any, interval: Sequence[float | None] | None, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    shown, symbol = in_reader_units(float(value), unit)
    gap = "" if symbol == "°" else " "
    text = f"{number(shown)}{gap}{symbol}".strip()
    if interval is None:
        return text
    low, high = (number(None if end is None else in_reader_units(float(end), unit)[0]) for end in interval)
    return f"{text} ({low} to {high})"


def effect_words(effect: Mapping[str, Any]) -> str:
    """Return an effect with its first number and its interval; rivals that remain are named with it."""
    match effect["level"]:
        case "EXACT":
            return _named(effect, interval=True)
        case "CLASS":
            return f"a {effect['class']} effect, {_either(effect)}"
        case _:
            return _either(effect)


MEANING = {
    "NONE": "nothing that matters beats noise, and what could still hide is shown to be too small to matter",
    "EXACT": "one name holds, on trajectories that the search had not seen, and no rival is left",
    "CLASS": "the kind of effect is sure, which one of its kind is not",
    "SET": "one of those listed is there; these data do not tell which",
    "UNKNOWN": "something real that no effect of the catalogue explains",
    "INCONCLUSIVE": "too little data, or nothing held on trajectories that the search had not seen",
}


def next_step(report: Mapping[str, Any]) -> str:
    """Return what to do now, in one sentence."""
    advice = report["next_experiment"]
    if advice is not None and advice["run"].startswith("equivalent"):
        return f"{' and '.join(advice['separates'])} are {advice['run']}"
    if advice is not None:
        return f"record: {advice['run']} ({advice['minutes']:.0f} min), to tell {' from '.join(advice['separates'])}"
    match report["verdict"]["level"]:
        case "NONE":
            return "stop looking: the model is as good as these sensors can tell"
        case "EXACT":
            return "use model.toml, for simulation and for the next run"
        case "UNKNOWN" if any(f["variables"] == ["frequency"] for f in report["localisation"][:1]):
            return "find what shakes at that frequency, whatever the arm does: a pump, a fan, the floor"
        case "UNKNOWN":
            return "look at the machine where the maps below are dark; no effect of the catalogue acts like that"
        case _ if not report["localisation"] and _tolerated(report) > MOST_TOLERATED:
            return "calibrate the table, or leave T_tracker_base out of the model: then it is registered from the data"
        case _ if report["provenance"].get("bursts") and not report["localisation"]:
            return "record more motions like those in which it happens: a name must hold on motions not seen"
        case _:
            return "record more trajectories, or with another outside sensor"


def _named(effect: Mapping[str, Any], *, interval: bool) -> str:
    sizes = [p for p in effect["parameters"].values() if p["ci95"] is not None]
    source = [f" from joint {p['value']}" for k, p in effect["parameters"].items() if k == "source"]
    name = f"{str(effect['name']).replace('_', ' ')}{''.join(source)}"
    if not sizes:
        return name
    return f"{name}, {parameter_words(sizes[0])}" if interval else f"{name} {_value_words(sizes[0])}"


def _either(effect: Mapping[str, Any], *, chances: bool = True) -> str:
    """Return an effect and up to two rivals, the most probable first."""
    said = [(effect["probability"], str(effect["name"]).replace("_", " "))]
    for rival in [r for r in effect["rivals"] if r["name"]]:
        where = "" if rival["joint"] == effect["joint"] else f" of {place(rival['joint'])}"
        said.append((rival["probability"], f"{str(rival['name']).replace('_', ' ')}{where}"))
    said.sort(key=lambda entry: -entry[0])
    return " or ".join(f"{name} ({_percent(chance)})" if chances else name for chance, name in said[:ALTERNATIVES])


def _short(effect: Mapping[str, Any]) -> str:
    """Return one of several effects of a place: its number only where that is short, rivals without probabilities."""
    if effect["level"] != "EXACT":
        return _either(effect, chances=False)
    sizes = [p for p in effect["parameters"].values() if p["ci95"] is not None]
    brief = {"parameters": {k: p for k, p in effect["parameters"].items() if p["ci95"] is None}}
    long = bool(sizes) and len(in_reader_units(0.0, sizes[0]["unit"])[1]) > LONG_UNIT
    return _named({**effect, **brief} if long else effect, interval=False)


@dataclass(frozen=True)
class Closed:
    """The channel with the largest gap of some, the share of it that is closed, and its size before over the noise."""

    channel: str
    share: float
    excess: float


def closed_by(report: Mapping[str, Any], joint: int | str | None = None) -> Closed | None:
    """Return the channel that had the largest gap over its noise, and how much of it is closed.

    Outside sensors come first: motor encoders see the transmission only through the servo's tiny answer to the load.

    Parameters
    ----------
    report : mapping
        The report's JSON form.
    joint : int, str or None
        Only channels of this joint, where it has any.
    """
    gaps = {name: g for name, g in report["gap"].items() if g["closed"] is not None and g["noise"]}
    own = {name: g for name, g in gaps.items() if isinstance(joint, int) and name.endswith(f"_{joint}")}
    chosen = own or gaps
    outside = {
        n: g for n, g in chosen.items() if not n.startswith("measured_jp") and g["before"] > VISIBLE * g["noise"]
    }
    found = [Closed(n, float(g["closed"]), g["before"] / g["noise"]) for n, g in (outside or chosen).items()]
    return max(found, key=lambda c: c.excess, default=None)


def verdict_sentence(report: Mapping[str, Any]) -> str:
    """Return the verdict in one sentence: what is missing, how much, and how much of the gap it closes."""
    level, effects = report["verdict"]["level"], report["verdict"]["effects"]
    if level == "NONE":
        return _nothing(report)
    if level == "INCONCLUSIVE" and not effects:
        return _undecided(report)
    named = _by_place(report, effects)
    if level != "UNKNOWN":
        return f"{named}."
    unknown = f"Something outside the catalogue is missing{_where(report)}"
    return f"{unknown}." if not effects else f"{unknown}. Beside it, {named[:1].lower()}{named[1:]}."


def _by_place(report: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects one place after the other, the one with the largest gap over its noise first."""
    groups: dict[Any, list[Mapping[str, Any]]] = {}
    for effect in effects:
        groups.setdefault(effect["joint"], []).append(effect)
    sizes = {where: closed_by(report, where) for where in groups}
    excess = {where: 0.0 if size is None else size.excess for where, size in sizes.items()}
    order = sorted(groups, key=lambda where: -excess[where])
    said = [_group_words(groups[where], sizes[where]) for where in order[:SHOWN]]
    others = sum(len(groups[where]) for where in order[SHOWN:])
    return "; ".join(said) + (f"; and {others} smaller elsewhere" if others else "")


def _group_words(effects: Sequence[Mapping[str, Any]], closed: Closed | None) -> str:
    where = place(effects[0]["joint"]).removeprefix("the ").capitalize()
    share = "" if closed is None else f"{_percent(min(closed.share, 1.0))} of the gap"
    if all(e["class"] == "noise" for e in effects):
        return f"{where}: {' + '.join(_named(e, interval=len(effects) == 1) for e in effects)}, noise: no gap to close"
    if len(effects) == 1:
        return f"{where}: {effect_words(effects[0])}" + (f", closes {share}" if share else "")
    names = " + ".join(map(_short, effects))
    return f"{where}: {names}, close {share}" if share else f"{where}: {names}"


def _nothing(report: Mapping[str, Any]) -> str:
    bounds = [e["systematic_upper"] for e in report["provenance"]["equivalence"] if e["systematic_upper"] is not None]
    rest = f"; what could still hide is below {100 * max(bounds):.0f} % of the noise" if bounds else ""
    faint = report["localisation"]  # no finding of these counts, or the verdict would be another
    size = 100 * faint[0]["size"] if faint else 0.0
    seen = (
        f"; {channel_words(faint[0]['channel'])} differs by {size:.0f} % of it, too little to matter" if faint else ""
    )
    share = _tolerated(report)
    beyond = f" and {TOLERANCES} ({100 * share:.0f} % of it)" if share > EQUIVALENCE else ""
    return f"Nothing is missing: simulation and recording agree up to noise{beyond}{rest}{seen}."


def _undecided(report: Mapping[str, Any]) -> str:
    if any(f.get("counts", True) for f in report["localisation"]):
        return (
            f"Not decided: simulation and recording differ{_where(report)}, but no name can be given from these data."
        )
    if bursts := report["provenance"].get("bursts"):
        return f"Not decided: something rare happens in the {_burst_words(bursts[0])}, too rarely for a name."
    if (share := _tolerated(report)) > MOST_TOLERATED:
        return (
            f"Not decided: what differs can be put down to {TOLERANCES}, but it is {100 * share:.0f} % of the noise: "
            "something else may hide in it."
        )
    return "Not decided: nothing beats noise, but these data are too few or too noisy to show that nothing is missing."


def _tolerated(report: Mapping[str, Any]) -> float:
    return max(report["provenance"].get("tolerated", {}).values(), default=0.0)


def _burst_words(burst: Mapping[str, Any]) -> str:
    """Return where a burst is, how large, and in which trajectories."""
    (size, unit), (noise, _) = (in_reader_units(burst[k], burst["unit"]) for k in ("largest", "noise"))
    loud = burst["trajectories"]
    numbers = f"trajectories {', '.join(map(str, loud[:SHOWN]))}" if len(loud) > 1 else f"trajectory {loud[0]}"
    more = " and others" if len(loud) > SHOWN else ""
    largest = f"up to {number(size)} {unit} in {numbers}{more}; noise {number(noise)} {unit}"
    return f"{channel_words(burst['channel'])} ({largest})"


def _where(report: Mapping[str, Any]) -> str:
    found = report["provenance"].get("remainder") or report["localisation"]
    if not found:
        return ""
    return f": {channel_words(found[0]['channel'])}, most at {found[0]['region']}"


def channel_words(channel: str) -> str:
    """Return a channel's name as people say it: "outside sensor of joint 2", "tracker x"."""
    signal, _, tail = channel.rpartition("_")
    kind = {"external_jp": "outside sensor of joint", "measured_jp": "motor encoder of joint", "tracker_cp": "tracker"}
    return f"{kind.get(signal, signal)} {tail}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"
