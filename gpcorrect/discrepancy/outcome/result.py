"""What a run of the workflow found, and its fixed form as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from gpcorrect.discrepancy.evidence.localise import Finding, Localisation
from gpcorrect.discrepancy.naming.named import Alternative, Named
from gpcorrect.discrepancy.outcome.gap import GapFigures
from gpcorrect.discrepancy.outcome.words import region_words
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.sim.model import Model
from gpcorrect.sim.plan import Plan
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["ChannelGap", "Discrepancy", "Evidence", "Experiment", "Level", "NamedEffect"]

Level = Literal["NONE", "EXACT", "CLASS", "SET", "UNKNOWN", "INCONCLUSIVE"]


@dataclass(frozen=True)
class NamedEffect:
    """An effect of the verdict, with its final numbers.

    Parameters
    ----------
    named : Named
        Name, level and posterior.
    parameters : dict
        For each parameter its value, 95 % interval and unit.
    """

    named: Named
    parameters: Mapping[str, Mapping[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        candidate = self.named.member.candidate
        return {
            "name": candidate.name,
            "joint": candidate.joint,
            "class": candidate.family,
            "level": self.named.level,
            "probability": self.named.probability,
            "parameters": {k: dict(v) for k, v in self.parameters.items()}
            | {k: {"value": v, "ci95": None, "unit": ""} for k, v in candidate.fixed},
            "rivals": [_alternative(r) for r in self.named.rivals],
            "alternatives": [_alternative(a) for a in self.named.alternatives],
            "nats": self.named.nats,
        }


def _alternative(entry: Alternative) -> dict[str, Any]:
    return {
        "label": entry.label,
        "name": entry.name,
        "joint": entry.joint,
        "class": entry.family,
        "probability": entry.probability,
    }


@dataclass(frozen=True)
class ChannelGap:
    """Figures of one channel on the sealed part, with the two yardsticks."""

    channel: str
    unit: str
    figures: GapFigures
    black_box_ceiling: float
    placebo: float

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        f = self.figures
        return {
            "before": f.before,
            "after": f.after,
            "noise": f.noise,
            "unit": self.unit,
            "closed": f.closed,
            "closed_ci95": list(f.closed_ci95),
            "black_box_ceiling": self.black_box_ceiling,
            "placebo": self.placebo,
            "p95": list(f.p95),
            "max": list(f.largest),
        }


@dataclass(frozen=True)
class Experiment:
    """The run that would tell two leaders apart.

    Parameters
    ----------
    run : str
        What to record.
    separates : pair of str
        The two.
    expected_nats : float
        Evidence it should bring after the rival was refitted.
    minutes : float
        How long it takes.
    plans : tuple of (Plan, float)
        Desired paths, each with the factor on the controller's gains; none when a sensor is advised.
    """

    run: str
    separates: tuple[str, str]
    expected_nats: float
    minutes: float
    plans: tuple[tuple[Plan, float], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "run": self.run,
            "separates": list(self.separates),
            "expected_nats": self.expected_nats,
            "minutes": self.minutes,
        }


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the figures are drawn from: condensed rows.

    Parameters
    ----------
    before, after : (m, c) arrays
        Residuals without and with the named effects.
    motor, direction : (m, k) arrays
        Motor path and direction of travel of each joint.
    joint : (c,) tuple of int
        Column of the joint that each channel speaks of, -1 for none.
    sealed : (m,) bool array
        Rows of the sealed part.
    correlation : (p, p) array
        Of the named effects' signatures and their rivals'.
    labels : tuple of str
        Its rows.
    waterfall : tuple of Step
        Of the search.
    """

    before: FloatArray
    after: FloatArray
    motor: FloatArray
    direction: FloatArray
    joint: tuple[int, ...]
    sealed: BoolArray
    correlation: FloatArray
    labels: tuple[str, ...]
    waterfall: tuple[Step, ...]


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Outcome of a run.

    Parameters
    ----------
    level : str
        NONE, EXACT, CLASS, SET, UNKNOWN or INCONCLUSIVE.
    effects : tuple of NamedEffect
        Named ones.
    unnamed : tuple of Named
        What helped in the search but may not be named.
    localisation : Localisation
        Before any effect was added.
    remainder : Localisation or None
        After; None when nothing was looked for.
    gap : tuple of ChannelGap
        Each channel on the sealed part.
    next_experiment : Experiment or None
        What to record next.
    model : Model
        With the named effects.
    evidence : Evidence
        For the figures.
    provenance : dict
        Data hashes, seed, versions, thresholds, seconds, remarks.
    """

    level: Level
    effects: tuple[NamedEffect, ...]
    unnamed: tuple[Named, ...]
    localisation: Localisation
    remainder: Localisation | None
    gap: tuple[ChannelGap, ...]
    next_experiment: Experiment | None
    model: Model
    evidence: Evidence
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the report's JSON form, numbers that do not exist as None."""
        report: dict[str, Any] = _finite(
            {
                "verdict": {"level": self.level, "effects": [e.to_dict() for e in self.effects]},
                "localisation": [_finding(f) for f in self.localisation.findings],
                "gap": {g.channel: g.to_dict() for g in self.gap},
                "next_experiment": None if self.next_experiment is None else self.next_experiment.to_dict(),
                "provenance": {
                    **self.provenance,
                    "remainder": [] if self.remainder is None else [_finding(f) for f in self.remainder.findings],
                    "equivalence": [
                        {"channel": e.channel, "systematic_upper": e.upper, "limit": e.limit}
                        for e in (self.remainder or self.localisation).equivalence
                    ],
                    "not_named": [
                        {
                            "label": n.member.candidate.label,
                            "level": n.level,
                            "probability": n.probability,
                            "nats": n.nats,
                            "why": list(n.reasons),
                        }
                        for n in self.unnamed
                    ],
                },
            }
        )
        return report


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "channel": finding.channel,
        "variables": list(finding.variables),
        "region": region_words(finding.region),
        "bounds": [asdict(span) for span in finding.region],
        "nats": finding.nats,
        "size": finding.size,
        "counts": finding.counts,
    }


def _finite(value: Any) -> Any:
    """Replace what JSON cannot say."""
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, np.generic | np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
