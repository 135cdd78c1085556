"""Recordings with hidden effects, for tests by someone who must not know them: logs here, labels sealed apart."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Container, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from gpcorrect.atomic import write_file
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import Candidate, all_candidates
from gpcorrect.errors import DataError
from gpcorrect.parallel import each
from gpcorrect.sim import Model, effect_from_dict, machine_of, read_model, simulate
from gpcorrect.sim.effects import Effect, in_order
from gpcorrect.sim.joint_motion import joint_motion_plan, joint_ranges
from gpcorrect.sim.resolve import rehomed
from gpcorrect.sim.settings import NonNegative, Positive, Settings
from gpcorrect.types import CalibrationLog, FloatArray, Progress

LABELS = "sealed"  # folder of the labels, beside the folder of the logs
TRIES = 40  # candidates of the catalogue drawn before giving up
SECANTS = 6  # steps towards the wanted ratio
CLOSE = 0.1  # of the wanted ratio
SHAPE_SPREAD = 0.5  # standard deviation of the logarithm of a shape parameter around its typical value
Count = Annotated[int, Field(strict=True, ge=1)]


class MotionTable(Settings):
    """What is recorded in every case."""

    trajectories: Count = 24
    seconds: Positive = 20.0
    sessions: Count = 1
    payloads: tuple[NonNegative, ...] = ()


class CaseTable(Settings):
    """Effects given by hand; none for a case in which nothing is missing."""

    repeat: Count = 1
    effects: tuple[dict[str, Any], ...] = ()


class DrawTable(Settings):
    """Effects drawn from the catalogue, which stand out of the noise by given ratios, taken in turn."""

    cases: Count
    effects: Count = 1
    effect_to_noise: Annotated[tuple[Positive, ...], Field(min_length=1)] = (2.0, 1.0, 0.5, 0.25)
    names: tuple[str, ...] = ()


class SpecTable(Settings):
    """A spec file."""

    model: str
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    motion: MotionTable = MotionTable()
    cases: tuple[CaseTable, ...] = ()
    draw: DrawTable | None = None


@dataclass(frozen=True)
class Spec:
    """The nominal machine, which the workflow will be given, and the rest of a spec file."""

    model: Model
    table: SpecTable


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, the effects hidden in it, and how far these stand out of the noise where they were drawn."""

    name: str
    log: CalibrationLog
    effects: tuple[Effect, ...]
    effect_to_noise: float | None


def read_spec(path: Path) -> Spec:
    """Read a spec file; the model's path is relative to it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        The file cannot be read, or a key is unknown, missing or of the wrong type.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise DataError(f"cannot read the spec file {path}: {error}.") from error
    try:
        table = SpecTable.model_validate(values)
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise DataError(f"{path}: {problems}.", hint="See docs/discrepancy.md for the keys of a spec file.") from error
    if not table.cases and table.draw is None:
        raise DataError(f"{path} asks for no case.", hint="Give [[cases]], or [draw] with cases = 10.")
    return Spec(read_model(path.parent / table.model), table)


def generate(spec: Spec, progress: Progress | None = None) -> Iterator[Case]:
    """Simulate every case of a spec, in an order that tells nothing.

    Parameters
    ----------
    spec : Spec
    progress : Progress, optional

    Yields
    ------
    Case
        With the same spec and seed the same ones.

    Raises
    ------
    DataError
        An effect is unknown or fits no joint of the model, or sizes are asked for and the model has no noise.
    """
    rng = np.random.default_rng([spec.table.seed, 41])
    wanted: list[tuple[tuple[Effect, ...], float | None]] = []
    for case in spec.table.cases:
        wanted += [(tuple(map(effect_from_dict, case.effects)), None)] * case.repeat
    wanted += _drawn(spec, spec.table.draw, rng) if spec.table.draw else []
    ordered = [(number, *wanted[index]) for number, index in enumerate(rng.permutation(len(wanted)))]
    yield from each(partial(_case, spec), ordered, progress, "simulating")


def _drawn(spec: Spec, draw: DrawTable, rng: np.random.Generator) -> Iterator[tuple[tuple[Effect, ...], float]]:
    scout = _log(spec, spec.model, rng, seed=0)
    for ratio in islice(cycle(draw.effect_to_noise), draw.cases):
        members: dict[Hashable, Effect] = {}
        for _ in range(draw.effects):
            candidate, effect = drawn_effect(spec.model, scout, ratio, rng, names=draw.names, besides=members)
            members[candidate.key] = effect
        yield tuple(members.values()), ratio


def _case(spec: Spec, case: tuple[int, tuple[Effect, ...], float | None]) -> Case:
    number, effects, ratio = case
    rng = np.random.default_rng([spec.table.seed, 42, number])
    hidden = spec.model.with_effects(*in_order((*spec.model.effects, *effects)))
    true = rehomed(hidden, spec.table.motion.sessions, rng)
    known = {id(e) for e in spec.model.effects}
    log = _log(spec, true, rng, seed=int(rng.integers(2**31)))
    return Case(f"case_{number:03d}", log, tuple(e for e in true.effects if id(e) not in known), ratio)


def _log(spec: Spec, model: Model, rng: np.random.Generator, seed: int) -> CalibrationLog:
    motion, machine = spec.table.motion, machine_of(model)
    plan = joint_motion_plan(
        joint_ranges(model),
        motion.trajectories,
        motion.seconds,
        machine.log_rate_hz,
        rng,
        sessions=motion.sessions,
        payloads=motion.payloads,
    )
    return simulate(machine, plan, seed)


def noise_of(model: Model, scene: Scene) -> FloatArray:
    """Return standard deviation `(c,)` of the noise that the model gives each channel; NaN for motor encoders.

    Parameters
    ----------
    model : Model
    scene : Scene

    Raises
    ------
    DataError
        The model has no noise.
    """
    noise = model.noise
    if noise is None:
        raise DataError("sizes relative to the noise need to know it.", hint="Give the model a [noise] table.")
    zeros = (0.0,) * len(model.joints)
    joint = np.hypot(noise.external_jp_white or zeros, noise.external_jp_ar_std or zeros)
    tracker = float(np.hypot(noise.tracker_white, noise.tracker_ar_std))
    turn = float(np.hypot(noise.tracker_rotation_white, noise.tracker_rotation_ar_std)) or np.nan  # not stated: unused
    by_channel = {"external_jp": joint.tolist(), "tracker_cp": [tracker] * 3, "tracker_rotation": [turn] * 3}
    std = np.array([by_channel[c.signal][c.index] if c.signal in by_channel else np.nan for c in scene.channels])
    if not (std[np.isfinite(std)] > 0).all():
        raise DataError(
            "the model's [noise] gives an outside signal no noise.", hint="Give external_jp_white or tracker_white."
        )
    return std


def effect_to_noise(scene: Scene, std: FloatArray, effects: Sequence[Effect]) -> float:
    """Return the largest of the outside channels' ratios: RMS of what the effects change, over the noise.

    Parameters
    ----------
    scene : Scene
    std : (c,) array, noise of each channel; NaN for those that do not count
    effects : sequence of Effect, that are added
    """
    change = scene.predict(effects) - scene.predict()
    outside = np.isfinite(std)
    return float((np.sqrt(np.nanmean(change**2, axis=0))[outside] / std[outside]).max())


def drawn_effect(
    model: Model,
    scout: CalibrationLog,
    ratio: float,
    rng: np.random.Generator,
    *,
    names: Sequence[str] = (),
    besides: Container[Hashable] = (),
) -> tuple[Candidate, Effect]:
    """Draw a candidate at random, and scale it until its effect stands out of the noise by about `ratio`.

    Parameters
    ----------
    model : Model, nominal machine, with its noise
    scout : CalibrationLog, a recording of it, by which sizes are measured
    ratio : float, root mean square of the change over the noise, in the channel where it is largest
    rng : numpy.random.Generator
    names : sequence of str, effects to draw from; all when empty
    besides : container of candidates' keys, already there: not drawn again

    Raises
    ------
    DataError
        No effect can reach the ratio, or the model has no noise.
    """
    scene = build_scene(scout, model, np.ones(len(scout), dtype=np.bool_)).strict()
    std = noise_of(model, scene)
    open_ones = [c for c in all_candidates(scene) if c.key not in besides and (not names or c.name in names)]
    keys = list(dict.fromkeys(c.name for c in open_ones))
    for _ in range(TRIES if keys else 0):
        name = keys[int(rng.integers(len(keys)))]
        same = [c for c in open_ones if c.name == name]
        candidate = same[int(rng.integers(len(same)))]
        effect = _sized(candidate, scene, std, ratio, rng)
        if effect is not None:
            return candidate, effect
    raise DataError(
        f"no effect of {', '.join(names) or 'the catalogue'} can stand out of the noise by {ratio:g} in this machine.",
        hint="Ask for other names, or give the model less noise.",
    )


def _sized(
    candidate: Candidate, scene: Scene, std: FloatArray, ratio: float, rng: np.random.Generator
) -> Effect | None:
    """Scale a candidate's amplitudes by secants; None when its physical range ends before the ratio is reached.

    Where it has none, its size is its first number, on a logarithmic scale, such as the radius of a play.
    """
    shape = np.array(candidate.start) + np.array(
        [0.0 if c.amplitude or c.kind != "log" else SHAPE_SPREAD * rng.standard_normal() for c in candidate.coordinates]
    )
    sign = np.array([1.0 if c.parameter.positive else rng.choice([-1.0, 1.0]) for c in candidate.coordinates])
    rows, factor = list(candidate.amplitudes), 1.0
    nothing = np.array([candidate.coordinates[i].identity for i in rows])
    full = sign[rows] * (np.array(candidate.start)[rows] - nothing)
    for _ in range(SECANTS):
        u = shape.copy()
        if rows:
            u[rows] = nothing + factor * full
        else:
            u[0] += np.log(factor)
        try:
            effect = candidate.build(np.clip(u, *candidate.bounds))
            reached = effect_to_noise(scene, std, [effect])
        except DataError:
            return None
        if abs(reached / ratio - 1.0) < CLOSE:
            return effect
        factor *= float(np.clip(ratio / max(reached, 1e-12), 1e-2, 1e2))
    return None


def seal(labels: Mapping[str, Any], folder: Path) -> str:
    """Write labels.json into a folder of its own under `folder`, and its SHA-256 beside the logs, which is returned.

    Whoever gets the logs and the hash, but not the folder, can later check that the labels were not changed.

    Parameters
    ----------
    labels : mapping of plain values
    folder : Path, folder of the logs

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    apart = folder / LABELS
    apart.mkdir(exist_ok=True)
    text = json.dumps(labels, indent=2, sort_keys=True)
    write_file(apart / "labels.json", text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    write_file(folder / "labels.sha256", f"{digest}  labels.json\n")
    return digest


def label_of(case: Case, log_sha256: str) -> dict[str, Any]:
    """Return what `gpcorrect discrepancy score` needs to know of a case.

    Parameters
    ----------
    case : Case, one of :func:`generate`
    log_sha256 : str, of its recording
    """
    effects = [{"class": str(e.about.family), "known": True} | e.to_dict() for e in case.effects]
    kinds = {0: "null", 1: "single", 2: "pair"}
    return {
        "set": kinds.get(len(effects), "triple"),
        "effects": effects,
        "effect_to_noise": case.effect_to_noise,
        "log_sha256": log_sha256,
    }
