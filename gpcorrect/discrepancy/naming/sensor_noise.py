"""Effects that change no mean: noise that grew, and encoders that count in steps.

The search looks for means and cannot find these. Each has a test of its own on the residual that the named effects
leave, or on the reported values themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.discrepancy.evidence.loudness import Growth, growth_of, levels_of, roughness, stated_level
from gpcorrect.discrepancy.naming.named import EXACT, Alternative, Named
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.counts import Counts, counts_of
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.stated import UNIFORM, sampling_step, stated_noises
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.coordinates import coordinate_of
from gpcorrect.discrepancy.search.state import penalty
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect
from gpcorrect.sim.effects.encoder_quantisation import EncoderQuantisation
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.sim.effects.noise_change import NoiseChange
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["NoiseEffect", "noise_effects"]

DENSE = 0.06  # s between samples at most: else second differences are motion
MATTERS = 0.1  # of the outside sensors' noise: rounding by less is no discrepancy
COARSER = 2.0  # times the stated encoder step


@dataclass(frozen=True, eq=False)
class NoiseEffect:
    """A named effect on noise, with its numbers as reports have them."""

    named: Named
    parameters: Mapping[str, Mapping[str, Any]]


def noise_effects(bench: Bench, effects: Sequence[Effect], level: FloatArray) -> tuple[NoiseEffect, ...]:
    """Return what the sensors' noise has that the model does not know of.

    Parameters
    ----------
    bench : Bench
        Recording and simulator.
    effects : sequence of Effect
        Named so far.
    level : (c,) array
        Standard deviation of the noise of single samples of every channel.
    """
    found = [_rounded(bench.scene, i, level) for i in range(len(bench.scene.joints))]
    coarse = {e.named.member.candidate.joint for e in found if e is not None}
    grown = _grown(bench, effects, coarse)
    return tuple(e for e in (*found, *grown) if e is not None)


def _grown(bench: Bench, effects: Sequence[Effect], coarse: set[int | str]) -> list[NoiseEffect]:
    """Louder outside sensors; a joint whose encoder counts in steps is louder by that."""
    scene = bench.scene
    if sampling_step(scene) > DENSE:
        return []
    groups: dict[int | str, list[int]] = {}
    for i, channel in enumerate(scene.channels):
        if channel.signal != "measured_jp" and channel.joint not in coarse:
            groups.setdefault(channel.joint or "tool", []).append(i)
    residual, seen = scene.residual(effects), _seen(bench)
    found = []
    for joint, indices in groups.items():
        growth = _growth(scene, residual[:, indices], seen, indices, len(groups))
        if growth is not None:
            found.append(_noise_change(scene.channels[indices[0]], joint, growth, len(groups)))
    return found


def _seen(bench: Bench) -> BoolArray:
    """(n,) log rows of discovery and confirmation."""
    rows = bench.group >= 0
    rows[rows] = bench.seen[bench.group[rows]]
    return rows


def _growth(
    scene: Scene, residual: FloatArray, seen: BoolArray, indices: Sequence[int], channels: int
) -> Growth | None:
    """Growth of one sensor; the axes of a tracker are one."""
    every = [levels_of(column, scene.trajectory, seen) for column in residual.T]
    numbers = every[0][1]
    if any(not np.array_equal(numbers, other) for _, other, _ in every) or not len(numbers):
        return None
    levels = np.exp(np.mean([np.log(level) for level, _, _ in every], axis=0))
    errors = np.mean([error for _, _, error in every], axis=0) / np.sqrt(len(every))
    clock = scene.layout.gather(scene.motion.time, len(scene))
    moments = [clock[scene.trajectory == k] for k in numbers]
    start, end = np.array([m.min() for m in moments]), np.array([m.max() for m in moments])
    known = [stated_noises(scene)[i] for i in indices]
    step = sampling_step(scene)
    stated = [stated_level(n, step) for n in known if n is not None]
    nominal = float(np.exp(np.mean(np.log(stated)))) if len(stated) == len(known) else None
    return growth_of(levels, errors, start, end, nominal, channels)


def _noise_change(channel: Channel, joint: int | str, growth: Growth, channels: int) -> NoiseEffect:
    kind = "P" if channel.unit == "m" else "R"
    parameters = {p.name: p for p in NoiseChange.about.parameters}
    coordinates = tuple(coordinate_of(parameters[name], kind, amplitude=True) for name in ("std", "since"))
    u = (growth.std / coordinates[0].typical, growth.since / coordinates[1].typical)
    candidate = Candidate(NoiseChange, joint, (), coordinates, (1, 0, 1), u, (0,))
    said = {
        "std": {"value": growth.std, "ci95": list(growth.std_ci95), "unit": channel.unit},
        "since": {"value": growth.since, "ci95": list(growth.since_ci95), "unit": "s"},
    }
    return NoiseEffect(_named(Member(candidate, np.array(u)), growth.nats, channels), said)


def _rounded(scene: Scene, column: int, level: FloatArray) -> NoiseEffect | None:
    """Return the encoder of one joint, when it counts in steps that matter."""
    if not scene.measured:
        return None
    counts = counts_of(scene.motor_path()[:, column])
    if counts is None or not _matters(scene, column, counts, level):
        return None
    joint, kind = scene.joints[column], scene.machine.body.types[column]
    (step,) = [p for p in EncoderQuantisation.about.parameters if p.name == "step"]
    coordinate = coordinate_of(step, kind, amplitude=True)
    u = (counts.step / coordinate.typical,)
    candidate = Candidate(EncoderQuantisation, joint, (), (coordinate,), (1, 0), u, (0,))
    ends = [counts.step - counts.error, counts.step + counts.error]
    said = {"step": {"value": counts.step, "ci95": ends, "unit": "m" if kind == "P" else "rad"}}
    # Each visited count beyond those that fix step and remainder agrees by chance in one of a hundred cases.
    nats = (counts.visited - 2) * float(np.log(100.0))
    return NoiseEffect(_named(Member(candidate, np.array(u)), nats, len(scene.joints)), said)


def _matters(scene: Scene, column: int, counts: Counts, level: FloatArray) -> bool:
    """Whether rounding is coarser than the model says, and large enough to be seen from outside."""
    joint = scene.joints[column]
    stated = scene.model.noise.encoder_step if scene.model.noise is not None else ()
    known = [e.step for e in scene.model.effects if isinstance(e, EncoderQuantisation) and e.joint == joint]
    if counts.step < COARSER * max([*stated[column : column + 1], *known], default=0.0):
        return False
    outside = np.array([c.signal != "measured_jp" for c in scene.channels])
    try:
        whole = scene.strict()
        change = whole.predict([HomingOffset(joint, counts.step / UNIFORM)]) - whole.predict()
    except DataError:
        return False
    size = np.sqrt(np.nanmean(change[:, outside] ** 2, axis=0))
    raw = np.array([roughness(r) for r in scene.residual()[:, outside].T])  # an outside sensor may be coarse as well
    return bool((size > MATTERS * np.maximum(level[outside], raw)).any())


def _named(member: Member, nats: float, tried: int) -> Named:
    """Named effect; against it stands only that nothing is there."""
    gain = nats - penalty(tried)
    probability = float(1.0 / (1.0 + np.exp(-np.clip(gain, -50.0, 50.0))))
    candidate = member.candidate
    mine = Alternative(
        candidate.label, candidate.name, candidate.joint, candidate.family, gain, probability=probability
    )
    nothing = Alternative("nothing", "", None, "", 0.0, probability=1.0 - probability)
    others = (nothing, Alternative("unknown", "", None, "", 0.0))
    return Named(member, "EXACT" if probability >= EXACT else "INCONCLUSIVE", probability, nats, (mine, *others), ())
