"""The fixed JSON form of a result: report.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gpcorrect.discrepancy.evidence.localise import Finding
from gpcorrect.discrepancy.naming.posterior import Alternative
from gpcorrect.discrepancy.outcome.origin import Provenance
from gpcorrect.discrepancy.outcome.words import noise_source_words, region_words
from gpcorrect.plain import json_ready

if TYPE_CHECKING:
    from gpcorrect.discrepancy.outcome.result import ChannelGap, DiscrepancyResult, NamedEffect, PlaceVerdict


def report_of(result: DiscrepancyResult) -> dict[str, Any]:
    """Return a result as plain values.

    Parameters
    ----------
    result : DiscrepancyResult
        Of a run.
    """
    experiment, remainder = result.next_experiment, result.remainder
    report: dict[str, Any] = {
        "version": 2,
        "verdict": {
            "level": str(result.level),
            "effects": [_effect(e) for e in result.effects],
            "minor": [_effect(e) for e in result.verdict.minor],
            "places": [_place(v) for v in result.verdict.places],
        },
        "localisation": [_finding(f) for f in result.localisation.findings],
        "gap": {g.channel.name: _gap(g) for g in result.gap},
        "next_experiment": None
        if experiment is None
        else {
            "run": experiment.run,
            "separates": list(experiment.separates),
            "expected_nats": experiment.expected_nats,
            "minutes": experiment.minutes,
        },
        "provenance": {
            **_provenance(result.provenance),
            "remainder": [] if remainder is None else [_finding(f) for f in remainder.findings],
            "equivalence": [
                {"channel": e.channel.name, "systematic_upper": e.upper, "limit": e.limit}
                for e in (remainder or result.localisation).equivalence
            ],
            "not_named": [
                {
                    "label": n.label,
                    "level": str(n.level),
                    "probability": n.probability,
                    "nats": n.nats,
                    "why": list(n.reasons),
                }
                for n in result.not_named
            ],
        },
    }
    plain: dict[str, Any] = json_ready(report)
    return plain


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "joint": effect.joint,
        "class": effect.family,
        "level": str(effect.level),
        "probability": effect.probability,
        "parameters": {k: {"value": e.value, "ci95": e.ci95, "unit": e.unit} for k, e in effect.parameters.items()},
        "rivals": [_alternative(a) for a in effect.rivals],
        "alternatives": [_alternative(a) for a in effect.alternatives],
        "nats": effect.nats,
        "size_over_noise": effect.size,
        "minor": effect.is_minor,
    }


def _place(verdict: PlaceVerdict) -> dict[str, Any]:
    return {
        "place": verdict.place,
        "level": str(verdict.level),
        "channel": verdict.channel.name,
        "before": verdict.before,
        "after": verdict.after,
        "noise": verdict.noise,
        "unit": verdict.channel.unit,
        "remaining_over_noise": verdict.remaining,
        "effects": verdict.effects,
    }


def _alternative(entry: Alternative) -> dict[str, Any]:
    return {
        "label": entry.label,
        "name": entry.name,
        "joint": entry.joint,
        "class": entry.family,
        "probability": entry.probability,
    }


def _finding(finding: Finding) -> dict[str, Any]:
    bounds = [{"variable": str(s.variable), "low": s.low, "high": s.high, "unit": s.unit} for s in finding.region]
    return {
        "channel": finding.channel.name,
        "variables": [str(v) for v in finding.variables],
        "region": region_words(finding.region),
        "bounds": bounds,
        "nats": finding.nats,
        "size": finding.size,
        "counts": finding.counts,
    }


def _gap(gap: ChannelGap) -> dict[str, Any]:
    return {
        "before": gap.before,
        "after": gap.after,
        "noise": gap.noise,
        "unit": gap.channel.unit,
        "closed": gap.closed,
        "closed_ci95": gap.closed_ci95,
        "black_box_ceiling": gap.black_box_ceiling,
        "placebo": gap.permutation_control,
        "p95": gap.p95,
        "max": gap.largest,
    }


def _provenance(source: Provenance) -> dict[str, Any]:
    return {
        "data": [vars(d) for d in source.data],
        "seed": source.seed,
        "versions": source.versions,
        "thresholds": vars(source.thresholds),
        "seconds": source.seconds,
        "noise": {
            name: {
                "white": n.white,
                "slow": n.slow,
                "time_constant": n.time_constant,
                "tail": n.tail,
                "basis": noise_source_words(n),
            }
            for name, n in source.noise.items()
        },
        "tolerated": source.tolerated,
        "bursts": [
            {
                "channel": b.channel.name,
                "trajectories": b.trajectories,
                "largest": b.largest,
                "noise": b.noise,
                "unit": b.channel.unit,
            }
            for b in source.bursts
        ],
        "remarks": source.remarks,
        "no_trace": source.no_trace,
        "not_nameable": [{"effect": k.effect, "why": k.why} for k in source.not_nameable],
    }
