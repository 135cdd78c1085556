"""The fixed JSON form of a result: report.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gpcorrect.discrepancy.evidence.localise import Finding
from gpcorrect.discrepancy.naming.posterior import Alternative
from gpcorrect.discrepancy.outcome.provenance import Provenance
from gpcorrect.discrepancy.outcome.words import noise_source_words, region_words
from gpcorrect.plain import json_ready

if TYPE_CHECKING:
    from gpcorrect.discrepancy.outcome.result import ChannelGap, DiscrepancyResult, NamedEffect, PlaceVerdict

EFFECTS = ("effects", "minor", "alike", "of_steps")  # of a verdict

VERSION = 2  # of report.json


def report_of(result: DiscrepancyResult) -> dict[str, Any]:
    """Return a result as plain values.

    Parameters
    ----------
    result : DiscrepancyResult
    """
    experiment, remainder = result.next_experiment, result.remainder
    report = {
        "version": VERSION,
        "verdict": {
            "level": result.level,
            **{kind: list(map(_effect, getattr(result.verdict, kind))) for kind in EFFECTS},
            "places": list(map(_place, result.verdict.places)),
        },
        "localisation": [_finding(f) for f in result.localisation.findings],
        "gap": {g.channel.name: _gap(g) for g in result.gap},
        "next_experiment": experiment and _fields(experiment, "run", "separates", "expected_nats", "minutes"),
        "provenance": {
            **_provenance(result.provenance),
            "remainder": [] if remainder is None else [_finding(f) for f in remainder.findings],
            "equivalence": [
                {"channel": e.channel.name, "systematic_upper": e.upper, "limit": e.limit}
                for e in (remainder or result.localisation).equivalence
            ],
            "not_named": [
                {**_fields(n, "label", "level", "probability", "nats"), "why": n.reasons} for n in result.not_named
            ],
        },
    }
    plain: dict[str, Any] = json_ready(report)
    return plain


def _fields(value: object, *names: str) -> dict[str, Any]:
    """Return what has the same name in the report."""
    return {name: getattr(value, name) for name in names}


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        **_fields(effect, "name", "joint"),
        "class": effect.family,
        **_fields(effect, "level", "probability"),
        "parameters": {k: _fields(e, "value", "ci95", "unit") for k, e in effect.parameters.items()},
        "rivals": [_alternative(a) for a in effect.rivals],
        "alternatives": [_alternative(a) for a in effect.alternatives],
        "nats": effect.nats,
        "size_over_noise": effect.size,
        "minor": effect.is_minor,
        **_fields(effect, "spread", "closes"),
    }


def _place(verdict: PlaceVerdict) -> dict[str, Any]:
    return {
        **_fields(verdict, "place", "level"),
        "channel": verdict.channel.name,
        **_fields(verdict, "before", "after", "noise"),
        "unit": verdict.channel.unit,
        "remaining_over_noise": verdict.remaining,
        "effects": [e.name for e in verdict.effects],
        "alike": [e.name for e in verdict.alike],
    }


def _alternative(entry: Alternative) -> dict[str, Any]:
    return {**_fields(entry, "label", "name", "joint", "source", "probability"), "class": entry.family}


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "channel": finding.channel.name,
        "variables": [str(v) for v in finding.variables],
        "region": region_words(finding.region),
        "bounds": [{"variable": str(s.variable), **_fields(s, "low", "high", "unit")} for s in finding.region],
        **_fields(finding, "nats", "size", "counts"),
    }


def _gap(gap: ChannelGap) -> dict[str, Any]:
    return {
        **_fields(gap, "before", "after", "noise"),
        "unit": gap.channel.unit,
        **_fields(gap, "closed", "closed_ci95", "black_box_ceiling"),
        "placebo": gap.permutation_control,
        "p95": gap.p95,
        "max": gap.largest,
    }


def _provenance(source: Provenance) -> dict[str, Any]:
    return {
        "data": list(map(vars, source.data)),
        **_fields(source, "seed", "versions"),
        "thresholds": vars(source.thresholds),
        "seconds": source.seconds,
        "noise": {
            name: {**_fields(n, "white", "slow", "time_constant", "tail"), "basis": noise_source_words(n)}
            for name, n in source.noise.items()
        },
        "tolerated": source.tolerated,
        "bursts": [
            {"channel": b.channel.name, **_fields(b, "trajectories", "largest", "noise"), "unit": b.channel.unit}
            for b in source.bursts
        ],
        **_fields(source, "remarks", "no_trace"),
        "not_nameable": list(map(vars, source.not_nameable)),
    }
