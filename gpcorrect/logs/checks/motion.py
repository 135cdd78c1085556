"""Checks of motions: signals that stand still while the robot moves, and speeds that no arm has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, Severity, examples
from gpcorrect.logs.checks.measure import repeats, runs, step_lengths
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Frozen", "Speed"]

REFERENCES = (
    ("tracker_cp", ("setpoint_cp", "measured_cp")),
    ("measured_cp", ("setpoint_cp",)),
    ("external_jp", ("setpoint_jp", "measured_jp")),
    ("measured_jp", ("setpoint_jp",)),
)
FROZEN_SAMPLES = 5  # repeats in a row; noise alone makes a living sensor differ sooner
MOVED_POSE = 1e-3  # m that the reference must have moved meanwhile: five times a good tracker's noise
MOVED_JOINT = np.deg2rad(1.0)  # rad, and m times ten
HELD_SHARE = 0.3  # of samples that repeat the one before while the robot moves: the rule, not the exception
HELD_RUNS = 10  # a held signal repeats often,
HELD_SPREAD = 2.0  # and nine runs in ten are at most so many times the usual one
HELD_FACTOR = 4.0  # a run this many times longer than the usual one is frozen even so
FASTEST_TIP = 2.0  # m/s; surgical arms stay below one
FASTEST_JOINT = {"R": 20.0, "P": 2.0}  # rad/s and m/s
MANY_JUMPS = 0.2  # of the samples; fewer are outliers, which cleaning is for


@dataclass(frozen=True)
class Frozen:
    """A sensor that repeats one value to the last bit while the robot moves sees nothing."""

    samples: int = FROZEN_SAMPLES

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield frozen stretches, and signals that are held between slower samples."""
        for name, references in REFERENCES:
            reference = next((r for r in references if evidence.has(name) and evidence.has(r)), None)
            if reference is None:
                continue
            same = repeats(evidence.log, evidence.table(name))
            moves = _moves(evidence, reference)
            stretches = runs(same)
            usual = _usual_hold(stretches) if moves.any() and same[moves].mean() > HELD_SHARE else 0.0
            least = max(self.samples, HELD_FACTOR * usual)
            stuck = [r for r in stretches if r[1] - r[0] >= least and _displaced(evidence, reference, r)]
            if stuck:
                yield _frozen(name, reference, np.array(stuck))
            if usual:
                yield _held(name, same[moves])


def _moves(evidence: Evidence, reference: str) -> BoolArray:
    """Rows in which the reference differs from the row before."""
    known = evidence.known(reference)
    changed = ~repeats(evidence.log, evidence.table(reference)) & np.isfinite(evidence.steps)
    moves: BoolArray = changed & known
    return moves


def _usual_hold(stretches: IntArray) -> float:
    """Usual number of repeats where they come regularly, 0 where they do not."""
    lengths = np.diff(stretches, axis=1)[:, 0]
    usual = float(np.median(lengths))
    regular = len(lengths) >= HELD_RUNS and np.percentile(lengths, 90) <= HELD_SPREAD * usual
    return usual if regular else 0.0


def _displaced(evidence: Evidence, reference: str, run: IntArray) -> bool:
    """Whether the reference moved clearly from the sample that is repeated to the last repetition."""
    part = evidence.table(reference)[run[0] - 1 : run[1]]
    part = part[np.isfinite(part).all(axis=1)]
    if len(part) < 2:
        return False
    if reference in evidence.log.POSES:
        return bool(np.linalg.norm(part[:, :3] - part[0, :3], axis=1).max() > MOVED_POSE)
    scale = np.ones(part.shape[1])
    for j, kind in enumerate(evidence.joint_types[: part.shape[1]]):
        scale[j] = 10.0 if kind == "P" else 1.0
    return bool((scale * np.abs(part - part[0])).max() > MOVED_JOINT)


def _frozen(name: str, reference: str, stretches: IntArray) -> Finding:
    lengths = np.diff(stretches, axis=1)[:, 0]
    what = (
        f"it is frozen {len(stretches)} times while {reference} moves, "
        f"for {int(lengths.max())} samples at most and {int(lengths.sum())} in all."
    )
    hint = "The tracker lost its target and repeated the last value: leave these samples out."
    return Finding("warning", "frozen", name, what, hint, int(lengths.sum()), examples(stretches[:, 0]))


def _held(name: str, same: BoolArray) -> Finding:
    times = 1.0 / max(1.0 - float(same.mean()), 1.0 / len(same))
    what = f"each value is repeated about {times:.2g} times: it was held between slower samples."
    hint = "Record it with its own stamps and let the reader interpolate: holding delays it by half its period."
    return Finding("warning", "held", name, what, hint, int(same.sum()))


@dataclass(frozen=True)
class Speed:
    """Nothing moves faster than an arm can."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding for each signal with impossible speeds."""
        step = np.where(evidence.steps > 0, evidence.steps, np.nan)
        for name in evidence.log.POSES:
            if evidence.has(name):
                speed = step_lengths(evidence.log, evidence.position(name)) / step
                yield from _fast(name, "", speed, FASTEST_TIP, "m/s")
        for name in ("setpoint_jp", "measured_jp", "external_jp"):
            if evidence.has(name):
                for j, kind in enumerate(evidence.joint_types[: evidence.table(name).shape[1]]):
                    speed = step_lengths(evidence.log, evidence.table(name)[:, [j]]) / step
                    unit = "m/s" if kind == "P" else "rad/s"
                    yield from _fast(name, f"joint {j + 1}: ", speed, FASTEST_JOINT[kind], unit)


def _fast(name: str, where: str, speed: FloatArray, limit: float, unit: str) -> Iterator[Finding]:
    rows = np.flatnonzero(speed > limit)
    if not rows.size:
        return
    share = rows.size / max(int(np.isfinite(speed).sum()), 1)
    severity: Severity = "error" if share > MANY_JUMPS else "warning"
    kind = "jumps" if severity == "warning" else "moves"
    top = float(speed[rows].max())
    count = f"{rows.size} samples ({share:.2%})"
    what = f"{where}it {kind} faster than {limit:g} {unit} in {count}, up to {top:.3g}."
    hint = "Cleaning drops lone jumps; many of them mean a wrong unit or bad stamps."
    yield Finding(severity, "speed", name, what, hint, int(rows.size), examples(rows))
