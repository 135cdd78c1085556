"""A machine of bare joints with known noise, and results made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.discrepancy.evidence.localise import Equivalence, Finding, Localisation
from gpcorrect.discrepancy.evidence.variables import Span
from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level
from gpcorrect.discrepancy.outcome.provenance import Provenance
from gpcorrect.discrepancy.outcome.result import ChannelGap, DiscrepancyResult, Evidence, NamedEffect, Verdict
from gpcorrect.discrepancy.outcome.sentences import verdict_sentences
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.discrepancy.search.needs import Lack
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.sim import Model, model_from_dict

NOMINAL: dict[str, Any] = {
    "arm": "joints",
    "joints": [1, 2],
    "joint_types": "RR",
    "log_rate_hz": 20.0,
    "noise": {"external_jp_white": [1e-3, 1e-3], "external_jp_ar_std": [5e-4, 5e-4]},
}
NOMINAL_TOML = """
arm = "joints"
joints = [1, 2]
joint_types = "RR"
log_rate_hz = 20.0

[noise]
external_jp_white = [1e-3, 1e-3]
external_jp_ar_std = [5e-4, 5e-4]
"""
OFFSET_SPEC = """
model = "nominal.toml"
seed = 5

[motion]
trajectories = 15
seconds = 6.0

[[cases]]
[[cases.effects]]
name = "homing_offset"
joint = 2
offset = 0.02
"""


def nominal() -> Model:
    """Return two revolute joints at 20 Hz, seen from outside with 1 mrad of noise."""
    return model_from_dict(NOMINAL)


def written_spec(folder: Path, spec: str = OFFSET_SPEC) -> Path:
    """Write nominal.toml and a spec into a folder; return the spec's path."""
    (folder / "nominal.toml").write_text(NOMINAL_TOML)
    (folder / "spec.toml").write_text(spec)
    return folder / "spec.toml"


def estimate(value: float, ci95: tuple[float, float] | None, unit: str) -> Estimate:
    """Return one number of an effect."""
    return Estimate(value, ci95, unit)


def rival(name: str, joint: int, probability: float, family: str = "reversal") -> Alternative:
    """Return another effect in an effect's place."""
    return Alternative(Explanation.EFFECT, probability, f"{name} ({joint})", name, joint, family)


def named(name: str, joint: int | str, level: str = "EXACT", **more: Any) -> NamedEffect:
    """Return one entry of a verdict."""
    effect = NamedEffect(
        name=name,
        joint=joint,
        family="reversal",
        level=Level(level),
        probability=0.97,
        nats=120.0,
        parameters={"radius": estimate(0.01, (0.009, 0.011), "rad")},
        alternatives=(
            Alternative(Explanation.NOTHING, 0.01, "nothing"),
            Alternative(Explanation.UNKNOWN, 0.02, "unknown"),
        ),
        rivals=(),
    )
    return replace(effect, **more)


def outside(joint: int) -> Channel:
    """Return the outside sensor of a joint."""
    return Channel(f"external_jp_{joint}", "external_jp", joint - 1, joint, "rad")


def finding(channel: Channel, *region: Span, nats: float = 50.0) -> Finding:
    """Return something that the tests found."""
    return Finding(channel, region, nats, 0.5)


def result(
    level: str,
    *effects: NamedEffect,
    findings: tuple[Finding, ...] = (),
    channels: tuple[Channel, ...] = (outside(1), outside(2)),
    sha256: str = "abc",
    seed: int = 0,
    **provenance: Any,
) -> DiscrepancyResult:
    """Return a result of two joints whose second one had a gap."""
    gap = ChannelGap(
        before=0.02,
        after=0.002,
        noise=0.001,
        p95=(0.04, 0.004),
        largest=(0.05, 0.006),
        closed=0.992,
        closed_ci95=(0.98, 0.995),
        channel=channels[-1],
        black_box_ceiling=0.99,
        permutation_control=0.01,
    )
    small = replace(gap, channel=channels[0], before=0.0011, after=0.0011, closed=0.0)
    noise = ChannelNoise(1e-3, 5e-4, 0.2)
    source = Provenance(
        name="log.csv",
        sha256=sha256,
        rows=100,
        seed=0,
        versions={},
        effect_nats=8.0,
        seconds=12.0,
        noise={c.name: noise for c in channels},
        tolerated={},
        bursts=(),
        servo_unseen=False,
        remarks=(),
        no_trace=(),
        not_nameable=(Lack("dh_error", "the log lacks tracker_cp"),),
    )
    return DiscrepancyResult(
        verdict=Verdict(Level(level), effects),
        not_named=(),
        localisation=Localisation(findings, 7.0, (Equivalence(channels[0], 0.1),)),
        remainder=None,
        gap=(small, gap),
        next_experiment=None,
        provenance=replace(source, **provenance),
        model=nominal(),
        evidence=evidence(seed),
    )


def verdict_sentence(found: DiscrepancyResult) -> str:
    """Return all of a verdict's sentences in a row."""
    return " ".join(verdict_sentences(found))


def evidence(seed: int = 0, rows: int = 400) -> Evidence:
    """Return rows of two joints whose residual depends on the direction of travel."""
    rng = np.random.default_rng(seed)
    motor = rng.uniform(-0.5, 0.5, (rows, 2))
    direction = rng.choice([-1.0, 1.0], (rows, 2))
    after = 1e-3 * rng.standard_normal((rows, 2))
    return Evidence(
        before=after + 0.02 * direction,
        after=after,
        motor=motor,
        direction=direction,
        joint=(0, 1),
        test=np.arange(rows) % 5 == 0,
        correlation=np.array([[1.0, 0.9], [0.9, 1.0]]),
        labels=("backlash (2)", "coulomb friction (2)"),
        waterfall=(Step("backlash (2)", 120.0), Step("without drift (1)", -4.0)),
    )
