"""What became of each hidden effect: the report of a run held against the sealed label of its recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from gpcorrect.discrepancy.outcome.result import ChannelGap
from gpcorrect.discrepancy.outcome.sentences import closed_by
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.sim.effects import EFFECTS

NO_NAME = ("set", "wrong set", "unknown", "inconclusive", "none")  # columns of the confusion matrix beside the names
Key = tuple[str, Any]


@dataclass(frozen=True)
class CaseOutcome:
    """One case, scored."""

    name: str
    group: str  # the set that it belongs to: "null", "single", "outside", ...
    ratio: float | None  # effect to noise, where it is known
    truth: tuple[str, ...]  # canonical names of the hidden effects; the name of what is outside the catalogue
    # what was reported of each: its own name, another one, or one of NO_NAME; one answer for a null case
    answers: tuple[str, ...]
    wrong: bool  # whether a name (or a set without the truth) was given that is not true
    unknown: bool  # whether the verdict is UNKNOWN and nothing wrong was named
    probabilities: tuple[tuple[float, bool], ...]  # of every name given: its posterior, and whether it is true
    covered: tuple[bool, ...]  # whether the 95 % interval of each comparable parameter, rightly named, holds the truth
    closed: float | None  # proportion of the gap closed where it was largest
    seconds: float  # time of the run

    @property
    def exact(self) -> bool:
        """Whether every hidden effect was named, and nothing else."""
        return bool(self.truth) and self.answers == self.truth and not self.wrong

    @property
    def right_or_set(self) -> bool:
        """Whether every hidden effect was named or is in a set that was given, and nothing wrong was named."""
        return all(a in (t, "set") for a, t in zip(self.answers, self.truth, strict=True)) and not self.wrong


def case_outcome(name: str, label: Mapping[str, Any], report: Mapping[str, Any]) -> CaseOutcome:
    """Score one report.

    Parameters
    ----------
    name : str
    label : mapping
        `set`, `effects` (each with `name`, `joint`, `known` and parameters), `effect_to_noise`, and perhaps `nuisance`:
        effects that are there too and may be named or not.
    report : mapping, the report's JSON form
    """
    named = report["verdict"]["effects"]
    true = {_key(e) for e in label["effects"] if e["known"]}
    allowed = true | {_key(e) for e in label.get("nuisance", [])}
    false = [e for e in named if not _possible(e) & allowed]
    single = [e for e in named if e["level"] == "EXACT"]
    answers = tuple(_answer(e, named, false, report["verdict"]["level"]) for e in label["effects"] or [{}])
    gaps = [_gap_of(name, gap) for name, gap in report["gap"].items()]
    closed = closed_by(gaps, label["effects"][0]["joint"] if label["effects"] else None)
    return CaseOutcome(
        name=name,
        group=label["set"],
        ratio=label["effect_to_noise"],
        truth=tuple(e["name"] for e in label["effects"]),
        answers=answers,
        wrong=bool(false),
        unknown=report["verdict"]["level"] == "UNKNOWN" and not false,
        probabilities=tuple((float(e["probability"]), _key(_flat(e)) in allowed) for e in single),
        covered=_covered(label["effects"], single),
        closed=None if closed is None else closed.closed,
        seconds=float(report["provenance"]["seconds"]),
    )


def _gap_of(name: str, gap: Mapping[str, Any]) -> ChannelGap:
    """Return a channel's gap as report.json has it."""
    signal, _, place = name.rpartition("_")  # a channel's name in JSON is its signal and its joint, or axis
    joint = int(place) if place.isdigit() else 0
    single = [gap[key] for key in ("before", "after", "noise", "closed", "black_box_ceiling", "placebo")]
    before, after, noise, closed, ceiling, control = np.array(single, dtype=np.float64).tolist()  # NaN for None
    p95, largest, ends = (tuple(np.array(gap[k], dtype=np.float64).tolist()) for k in ("p95", "max", "closed_ci95"))
    channel = Channel(name, signal, joint - 1 if joint else "xyz".index(place), joint, gap["unit"])
    return ChannelGap(before, after, noise, p95, largest, closed, ends, channel, ceiling, control)


def _flat(effect: Mapping[str, Any]) -> dict[str, Any]:
    """Named effect with its plain values beside its name, as labels have them."""
    return {"name": effect["name"], "joint": effect["joint"]} | {k: p["value"] for k, p in effect["parameters"].items()}


def _key(effect: Mapping[str, Any]) -> Key:
    """Return what an effect is, whatever its numbers: name, place, and the joint that it is driven by."""
    return (f"{effect['name']} {effect.get('source') or ''}".strip(), effect["joint"])


def _possible(effect: Mapping[str, Any]) -> set[Key]:
    """Everything that an entry of a verdict says it may be."""
    own = {_key(_flat(effect))}
    return own if effect["level"] == "EXACT" else own | {_key(r) for r in effect["rivals"]}


def _answer(
    truth: Mapping[str, Any], named: Sequence[Mapping[str, Any]], false: Sequence[Mapping[str, Any]], level: str
) -> str:
    """Return what a report says in the place of one hidden effect."""
    if truth and truth["known"]:
        holding = [e for e in named if _key(truth) in _possible(e)]
        if any(e["level"] == "EXACT" for e in holding):
            return str(truth["name"])
        if holding:
            return "set"
    for wrong in (e for e in false if e["level"] == "EXACT"):
        return str(wrong["name"])
    if false:
        return "wrong set"
    return {"UNKNOWN": "unknown", "NONE": "none"}.get(level, "inconclusive")


def _covered(truth: Sequence[Mapping[str, Any]], named: Sequence[Mapping[str, Any]]) -> tuple[bool, ...]:
    """Whether the intervals of the rightly named hold the truth, a period to either side where there is one."""
    found = []
    for effect, answer in product(truth, named):
        if _key(_flat(answer)) != _key(effect):
            continue
        periods = {p.name: p.period for p in EFFECTS[answer["name"]].about.parameters}
        for parameter, reported in answer["parameters"].items():
            value, estimate, ends = effect.get(parameter), reported["value"], reported["ci95"] or [None]
            if isinstance(value, float) and isinstance(estimate, float) and None not in ends:
                if period := periods.get(parameter):  # the turn nearest to what is reported
                    value += period * round((estimate - value) / period)
                found.append(bool(ends[0] <= value <= ends[1]))
    return tuple(found)
