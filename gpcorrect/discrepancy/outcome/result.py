"""What a run of the workflow found: frozen values from the verdict down to its numbers, and report.json of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gpcorrect.discrepancy.evidence.localise import Finding, Localisation
from gpcorrect.discrepancy.naming.posterior import Alternative, Level, Named
from gpcorrect.discrepancy.outcome.provenance import Provenance
from gpcorrect.discrepancy.outcome.words import noise_source_words, region_words
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.discrepancy.settings import NAMING, TESTS, VERDICT
from gpcorrect.plain import json_ready
from gpcorrect.sim.effects import EFFECTS, Family
from gpcorrect.sim.model import Model
from gpcorrect.sim.plan import Plan
from gpcorrect.types import BoolArray, FloatArray

VERSION = 2  # of report.json
KINDS = ("effects", "minor", "alike", "of_steps")  # of effects in a verdict


@dataclass(frozen=True)
class NamedEffect:
    """An effect of the verdict, with its final numbers.

    Parameters
    ----------
    name, family : str, canonical name and class in the catalogue
    joint : int or str, number of the joint, or "all", "tool", "base"
    level : Level, EXACT, CLASS or SET
    probability : float, posterior of this very effect
    nats : float, log Bayes factor against nothing, on trajectories that the fit had not seen
    parameters : dict of str to Estimate
        Value, 95 % interval and unit of each; a field that is no number to estimate (a source) has no interval.
    alternatives : tuple of Alternative
        What could stand in its place, itself, nothing and the unknown among them, most probable first.
    rivals : tuple of Alternative, those other effects that cannot be ruled out
    size : float, root mean square of what it changes over the noise, in the channel where that is largest
    of_motor : bool, whether that channel is a motor's
    spread : float, by how much its size differs between trajectories beyond noise, as a part of the size
    closes : float
        Part of the gap that all effects together close where it shows, on the test set; 1 where the rest may be noise.
    label : str, the candidate's, as that of an alternative
    """

    name: str
    joint: int | str
    family: str
    level: Level
    probability: float
    nats: float
    parameters: Mapping[str, Estimate]
    alternatives: tuple[Alternative, ...]
    rivals: tuple[Alternative, ...]
    size: float = float("inf")
    of_motor: bool = False
    spread: float = 0.0
    closes: float = 1.0
    label: str = ""

    @property
    def is_constant(self) -> bool:
        """Whether it is the same in every motion, as what a machine is must be to have a name.

        Friction need not be, nor what remembers pauses that are not logged.
        """
        about = EFFECTS[self.name].about
        return about.family == Family.REVERSAL or about.carries_over or self.spread <= NAMING.constant

    @property
    def is_whole(self) -> bool:
        """Whether what is left where it shows may be noise, or is little: else it is a part of something else."""
        return self.closes >= VERDICT.whole

    @property
    def is_a_name(self) -> bool:
        """Whether the machine has it, and does not only act like it."""
        return self.is_constant and self.is_whole

    @property
    def half_count(self) -> float:
        """How far, rad or m, what it rounds may be off in the mean: motors that a controller holds at a count stay."""
        rounds = self.family == Family.NOISE and "step" in self.parameters
        return 0.5 * float(self.parameters["step"].value) if rounds else 0.0  # type: ignore[arg-type]

    @property
    def is_minor(self) -> bool:
        """Whether it is too small to matter, however sure: it does not lead a headline."""
        return self.size < TESTS.equivalence

    @classmethod
    def of(
        cls, named: Named, numbers: Mapping[str, Estimate], size: float = float("inf"), *, of_motor: bool = False
    ) -> NamedEffect:
        """Take over what was named.

        Parameters
        ----------
        named : Named
        numbers : mapping of str to Estimate, of its parameters
        size : float, over the noise; infinite where it changes no mean
        of_motor : bool, whether it shows most in a motor's channel
        """
        candidate = named.fit.candidate
        return cls(
            candidate.name,
            candidate.joint,
            candidate.family,
            named.level,
            named.probability,
            named.nats,
            {**numbers, **{k: Estimate(v, None, "") for k, v in candidate.fixed}},
            named.alternatives,
            named.rivals,
            size,
            of_motor,
            named.spread,
            label=candidate.label,
        )


@dataclass(frozen=True)
class UnnamedEffect:
    """What helped in the search but may not be named, and why: `reasons` are for people."""

    label: str
    level: Level
    probability: float
    nats: float
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class PlaceVerdict:
    """What a run comes to at one joint, or at the tool."""

    place: int | str  # number of the joint; "tool" for what a tracker alone sees
    level: Level
    gap: ChannelGap  # of the channel in which it was largest over its noise
    remaining: float  # largest systematic part that is left, over the noise of its channel
    effects: tuple[NamedEffect, ...]  # named there
    alike: tuple[NamedEffect, ...] = ()  # what the machine acts like there


@dataclass(frozen=True)
class Verdict:
    """The level of the whole, the effects that are named, and the level of each place.

    Parameters
    ----------
    effects : tuple of NamedEffect, named, and in the model
    places : tuple of PlaceVerdict, of each joint, and of the tool
    minor : tuple of NamedEffect, sure, but too small to matter beside those, and not in the model
    alike : tuple of NamedEffect
        What the machine acts like, though not by the same size in every motion, or only in a part of what it does: in
        the model, for it closes a gap, and no name.
    of_steps : tuple of NamedEffect, no more than how two programs step one servo: in the model, and no name
    """

    level: Level
    effects: tuple[NamedEffect, ...] = ()
    places: tuple[PlaceVerdict, ...] = ()
    minor: tuple[NamedEffect, ...] = ()
    alike: tuple[NamedEffect, ...] = ()
    of_steps: tuple[NamedEffect, ...] = ()


@dataclass(frozen=True)
class ChannelGap:
    """One channel on the test set, in its unit; NaN for what does not exist."""

    # root mean squares of the residual without and with the effects, and of noise alone
    before: float
    after: float
    noise: float
    p95: tuple[float, float]  # 95th percentile of the absolute residual, before and after
    largest: tuple[float, float]  # its maximum
    closed: float  # 1 - (after^2 - noise^2) / (before^2 - noise^2); NaN where there is no gap to close
    closed_ci95: tuple[float, float]  # bootstrap over trajectories
    channel: Channel
    black_box_ceiling: float  # fraction that a black box closes
    permutation_control: float  # the same of a permutation control
    chance: float = 1.0  # that noise alone leaves as much on the test set, after

    @property
    def narrows(self) -> bool:
        """Whether what the effects take from its mean square matters beside its noise."""
        return bool(self.before**2 - self.after**2 > (TESTS.equivalence * self.noise) ** 2)

    @property
    def is_beyond_chance(self) -> bool:
        """Whether noise alone would not leave as much after."""
        return self.chance < VERDICT.chance


@dataclass(frozen=True)
class Experiment:
    """The run that would tell two leaders apart."""

    run: str  # what to record, for people; or which sensor to add, where no run is enough
    decisive: bool  # whether it is expected to tell them apart
    separates: tuple[str, str]  # the two
    expected_nats: float  # log Bayes factor that it should bring after the rival was refitted
    minutes: float  # that it takes


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the figures are drawn from: m condensed rows of c channels and k joints, and p named effects."""

    before: FloatArray  # (m, c) residuals without the named effects
    after: FloatArray  # (m, c) and with them
    motor: FloatArray  # (m, k) motor path
    direction: FloatArray  # (m, k) of travel
    joint: tuple[int, ...]  # (c,) column of the joint that each channel speaks of, -1 for none
    test: BoolArray  # (m,) rows of the test set
    correlation: FloatArray  # (p, p) of the effects' signatures
    labels: tuple[str, ...]  # (p,)
    waterfall: tuple[Step, ...]  # of the search


@dataclass(frozen=True, eq=False)
class DiscrepancyResult:
    """Outcome of a run.

    Parameters
    ----------
    not_named : tuple of UnnamedEffect, what helped in the search but may not be named
    localisation : Localisation, where the nominal model and the recording disagree
    remainder : Localisation or None, the same with the named effects; None when nothing was looked for
    gap : tuple of ChannelGap, each channel on the test set
    next_experiment : Experiment or None, what to record next; None when nothing is open
    model : Model, with the named effects, and those that the machine acts like
    evidence : Evidence, for the figures
    advised_plans : tuple of (Plan, float)
        Desired paths of the next experiment, each with the factor on the controller's gains; none when a sensor is
        advised, or when the result was read back.
    read_back : bool, whether the result is that of an earlier, finished run, read from its stages
    """

    verdict: Verdict
    not_named: tuple[UnnamedEffect, ...]
    localisation: Localisation
    remainder: Localisation | None
    gap: tuple[ChannelGap, ...]
    next_experiment: Experiment | None
    provenance: Provenance
    model: Model
    evidence: Evidence
    advised_plans: tuple[tuple[Plan, float], ...] = ()
    read_back: bool = False

    @property
    def level(self) -> Level:
        """Of the verdict."""
        return self.verdict.level

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """The named effects."""
        return self.verdict.effects

    def to_report(self) -> dict[str, Any]:
        """Return the content of report.json; numbers that do not exist are None."""
        experiment, remainder = self.next_experiment, self.remainder
        report = {
            "version": VERSION,
            "verdict": {
                "level": self.level,
                **{kind: list(map(_effect, getattr(self.verdict, kind))) for kind in KINDS},
                "places": list(map(_place, self.verdict.places)),
            },
            "localisation": [_finding(f) for f in self.localisation.findings],
            "gap": {g.channel.name: _gap(g) for g in self.gap},
            "next_experiment": experiment and _fields(experiment, "run", "separates", "expected_nats", "minutes"),
            "provenance": {
                **_provenance(self.provenance, self.localisation.threshold),
                "remainder": [] if remainder is None else [_finding(f) for f in remainder.findings],
                "equivalence": [
                    {"channel": e.channel.name, "systematic_upper": e.upper, "limit": TESTS.equivalence}
                    for e in (remainder or self.localisation).equivalence
                ],
                "not_named": [
                    {**_fields(n, "label", "level", "probability", "nats"), "why": n.reasons} for n in self.not_named
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
        "channel": verdict.gap.channel.name,
        **_fields(verdict.gap, "before", "after", "noise"),
        "unit": verdict.gap.channel.unit,
        "remaining_over_noise": verdict.remaining,
        "effects": [e.name for e in verdict.effects],
        "alike": [e.name for e in verdict.alike],
    }


def _alternative(entry: Alternative) -> dict[str, Any]:
    return {**_fields(entry, "label", "name", "joint", "source", "probability"), "class": entry.family}


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "channel": finding.channel.name,
        "variables": [str(s.variable) for s in finding.region],
        "region": region_words(finding.region),
        "bounds": [
            {"variable": str(s.variable), **_fields(s, "low", "high"), "unit": s.variable.unit} for s in finding.region
        ],
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


def _provenance(source: Provenance, localisation_nats: float) -> dict[str, Any]:
    return {
        "data": [_fields(source, "name", "sha256", "rows")],
        **_fields(source, "seed", "versions"),
        "thresholds": {
            "localisation_nats": localisation_nats,
            "effect_nats": source.effect_nats,
            "exact_probability": NAMING.exact,
            "rival_probability": NAMING.stable,
        },
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
        **_fields(source, "servo_unseen", "remarks", "no_trace"),
        "not_nameable": list(map(vars, source.not_nameable)),
    }
