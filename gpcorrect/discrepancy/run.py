"""The workflow: split, localise, search, name, add, and figures on the part that nothing has seen."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

import gpcorrect
from gpcorrect.discrepancy.bench import Bench, build_bench
from gpcorrect.discrepancy.candidates import Member, all_candidates, describe
from gpcorrect.discrepancy.cells import Cells, all_cells
from gpcorrect.discrepancy.controls import black_box, placebo
from gpcorrect.discrepancy.covariates import Covariates, covariates_of, travel_direction
from gpcorrect.discrepancy.gap import closed_gap, gap_figures, rms
from gpcorrect.discrepancy.lens import estimate_noises, lens_on
from gpcorrect.discrepancy.localise import ChannelData, Localisation, localise
from gpcorrect.discrepancy.name import EXACT, STABLE, Named, half_widths, name_members, smooth_nats
from gpcorrect.discrepancy.next_experiment import advise
from gpcorrect.discrepancy.noise import ChannelNoise
from gpcorrect.discrepancy.result import ChannelGap, Discrepancy, Evidence, Level, NamedEffect
from gpcorrect.discrepancy.scene import Scene, build_scene
from gpcorrect.discrepancy.score import Search, penalty, search, start_search, touch_alike
from gpcorrect.discrepancy.split import split_rows
from gpcorrect.discrepancy.trial import refine
from gpcorrect.sim.effects import in_order
from gpcorrect.sim.model import Model
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, Progress

__all__ = ["RunSettings", "find_discrepancy"]

NAMED = ("EXACT", "CLASS", "SET")
ORDER: tuple[Level, ...] = ("EXACT", "CLASS", "SET")


@dataclass(frozen=True)
class RunSettings:
    """What may be chosen.

    Parameters
    ----------
    seed : int
        Of the split and everything drawn.
    rounds : int
        Of the search, at most one effect a joint in each.
    tolerance : float or None
        Task tolerance (rad or m) under which a systematic part does not matter.
    max_rows : int
        Condensed rows that evidence is taken from.
    """

    seed: int = 0
    rounds: int = 4
    tolerance: float | None = None
    max_rows: int = 9000


@dataclass(frozen=True, eq=False)
class _Data:
    """A recording laid on the bench, with the tests of each channel."""

    bench: Bench
    cells: tuple[tuple[Cells, ...], ...]
    inputs: tuple[Covariates, ...]
    remarks: tuple[str, ...]

    @property
    def seen(self) -> BoolArray:
        return self.bench.part != 2


def find_discrepancy(
    log: CalibrationLog, model: Model, settings: RunSettings | None = None, progress: Progress | None = None
) -> Discrepancy:
    """Find where a model and a recording disagree, name what is missing, add it, and measure what that closes.

    Parameters
    ----------
    log : CalibrationLog
        Recording with the motor side (measured_jp or setpoint_jp) and an outside signal (external_jp or tracker_cp).
    model : Model
        What is known of the machine, with the effects it already has.
    settings : RunSettings, optional
        Seed, rounds, tolerance.
    progress : Progress, optional
        Told of every stage.

    Returns
    -------
    Discrepancy

    Raises
    ------
    DataError
        The log lacks a needed signal or is too short to split.
    """
    settings, progress, started = settings or RunSettings(), progress or Progress(), time.monotonic()
    rng = np.random.default_rng(settings.seed)
    data = _prepare(log, model, settings, rng)
    bench = data.bench
    progress.step("localising", 0.0)
    noises = estimate_noises(bench, bench.residual(), data.seen)
    before = _localise(data, (), noises, settings, rng)
    progress.step("localising", 1.0)
    state, named = _search(data, before, settings, progress)
    kept, dropped = _named_only(state, named)
    members = _refit(state, [n.member for n in kept], data.seen)
    effects = _with_numbers(state, kept, members, data.seen)
    final = estimate_noises(bench, state.observed - bench.predict([m.effect for m in members]), data.seen)
    remainder = _localise(data, members, final, settings, rng) if before.something else None
    progress.step("sealed part", 0.0)
    gap = _gaps(data, members, final, rng)
    progress.step("sealed part", 1.0)
    return Discrepancy(
        level=_verdict(data, state, before, effects, members),
        effects=effects,
        unnamed=tuple(dropped),
        localisation=before,
        remainder=remainder,
        gap=gap,
        next_experiment=advise(bench.scene, members, [*kept, *dropped], final, settings.seed),
        model=model.with_effects(*in_order((*model.effects, *(m.effect for m in members)))),
        evidence=_evidence(data, state, members),
        provenance=_provenance(log, settings, data, state, before, time.monotonic() - started),
    )


def _prepare(log: CalibrationLog, model: Model, settings: RunSettings, rng: np.random.Generator) -> _Data:
    split = split_rows(log.time, log.trajectory, log.session, rng)
    scene = build_scene(log, model, split.seen)
    bench = build_bench(scene, split, settings.max_rows)
    by_joint: dict[int, Covariates] = {}
    inputs = []
    for channel in scene.channels:
        if channel.joint not in by_joint:
            by_joint[channel.joint] = _condensed(bench, covariates_of(scene, channel.index if channel.joint else None))
        inputs.append(by_joint[channel.joint])
    cells = {joint: tuple(all_cells(c)) for joint, c in by_joint.items()}
    remarks = (split.remark, *scene.remarks)
    return _Data(bench, tuple(cells[c.joint] for c in scene.channels), tuple(inputs), remarks)


def _condensed(bench: Bench, covariates: Covariates) -> Covariates:
    """Covariates of the condensed rows: the value at the middle sample, so that signs stay signs."""
    used = np.flatnonzero(bench.group >= 0)
    group = bench.group[used]
    first = np.searchsorted(group, np.arange(len(bench)))
    last = np.searchsorted(group, np.arange(len(bench)), side="right") - 1
    middle = used[(first + last) // 2]
    values = {name: v[middle] for name, v in covariates.values.items()}
    kept = {name: v for name, v in values.items() if np.std(v) > 0}
    return Covariates(kept, tuple(p for p in covariates.primary if p in kept))


def _localise(
    data: _Data,
    members: Sequence[Member],
    noises: tuple[ChannelNoise, ...],
    settings: RunSettings,
    rng: np.random.Generator,
) -> Localisation:
    bench = data.bench
    residual = bench.residual([m.effect for m in members])
    lens = lens_on(bench, residual, data.seen, noises)
    channels = [
        ChannelData(c.name, bench.time, residual[:, i], lens.blocks[i], noises[i], data.cells[i])
        for i, c in enumerate(bench.scene.channels)
    ]
    tolerance = {} if settings.tolerance is None else {c.name: settings.tolerance for c in bench.scene.channels}
    return localise(channels, rng, tolerance=tolerance)


def _search(
    data: _Data, before: Localisation, settings: RunSettings, progress: Progress
) -> tuple[Search, tuple[Named, ...]]:
    """Search and naming, when there is something to name."""
    scene = data.bench.scene
    candidates = all_candidates(scene.joints, scene.machine.body.types, scene.n_sessions) if before.something else []
    state = start_search(data.bench, candidates, progress=progress)
    if not state.candidates:
        return state, ()
    state = search(state, rounds=settings.rounds, progress=progress)
    return state, name_members(state, data.cells, progress=progress)


def _named_only(state: Search, named: Sequence[Named]) -> tuple[list[Named], list[Named]]:
    """Those that may be named, and the others; what was named has to hold without the others."""
    kept = [n for n in named if n.level in NAMED]
    return kept, [n for n in named if n.level not in NAMED]


def _refit(state: Search, members: Sequence[Member], rows: BoolArray) -> tuple[Member, ...]:
    """Estimate all numbers anew on these rows, together where effects show in common channels."""
    if not members:
        return ()
    bench = state.bench
    residual = state.observed - bench.predict([m.effect for m in members])
    lens = lens_on(bench, residual, rows, estimate_noises(bench, residual, rows))
    done = list(members)
    for group in _groups(state, members):
        fixed = [m for i, m in enumerate(done) if i not in group]
        fresh = refine(bench, lens, state.observed, fixed, [done[i] for i in group])
        for i, member in zip(group, fresh, strict=True):
            done[i] = member
    return tuple(done)


def _groups(state: Search, members: Sequence[Member]) -> list[list[int]]:
    """Indices of members that are linked by common channels."""
    groups: list[list[int]] = []
    for i, member in enumerate(members):
        linked = [g for g in groups if any(touch_alike(state, members[k].candidate, member.candidate) for k in g)]
        groups = [g for g in groups if g not in linked] + [[k for g in linked for k in g] + [i]]
    return groups


def _with_numbers(
    state: Search, kept: Sequence[Named], members: Sequence[Member], rows: BoolArray
) -> tuple[NamedEffect, ...]:
    if not members:
        return ()
    residual = state.observed - state.bench.predict([m.effect for m in members])
    lens = lens_on(state.bench, residual, rows, estimate_noises(state.bench, residual, rows))
    found = []
    for i, (named, member) in enumerate(zip(kept, members, strict=True)):
        widths = half_widths(state, lens, members, i)
        found.append(NamedEffect(replace(named, member=member), describe(member, widths)))
    return tuple(sorted(found, key=lambda e: -e.named.nats))


def _verdict(
    data: _Data, state: Search, before: Localisation, effects: Sequence[NamedEffect], members: Sequence[Member]
) -> Level:
    if not before.something:
        return "NONE" if before.nothing else "INCONCLUSIVE"
    residual = state.observed - state.bench.predict([m.effect for m in members])
    confirmation = lens_on(state.bench, residual, state.bench.part == 1, state.lens.noises)
    left = smooth_nats(state, confirmation, data.cells, members, np.ones(residual.shape[1], dtype=np.bool_))
    if not effects:
        return "UNKNOWN" if left > penalty(max(state.n_kinds, 1)) else "INCONCLUSIVE"
    if left > sum(e.named.nats for e in effects):
        return "UNKNOWN"
    return ORDER[max(ORDER.index(e.named.level) for e in effects)]  # type: ignore[arg-type]  # kept effects have one of these


def _gaps(
    data: _Data, members: Sequence[Member], noises: Sequence[ChannelNoise], rng: np.random.Generator
) -> tuple[ChannelGap, ...]:
    bench = data.bench
    before, after = bench.residual(), bench.residual([m.effect for m in members])
    nominal = bench.predict()
    changes = [bench.predict([m.effect]) - nominal for m in members]
    sealed = bench.part == 2
    gaps = []
    for i, channel in enumerate(bench.scene.channels):
        noise = noises[i].std
        figures = gap_figures(before[sealed, i], after[sealed, i], noise, bench.block[sealed], rng)
        inputs = np.stack(list(data.inputs[i].values.values()), axis=1)
        boxed = black_box(inputs, before[:, i], data.seen, rng)
        columns = [c[:, i] for c in changes if c[:, i].any()]
        fooled = float("nan")
        if columns:
            left = placebo(np.stack(columns, axis=1), before[:, i], bench.block, data.seen, rng)
            fooled = float(closed_gap(figures.before, rms(left[sealed]), noise))
        ceiling = float(closed_gap(figures.before, rms(boxed[sealed]), noise))
        gaps.append(ChannelGap(channel.name, channel.unit, figures, ceiling, fooled))
    return tuple(gaps)


def _evidence(data: _Data, state: Search, members: Sequence[Member]) -> Evidence:
    bench, scene = data.bench, data.bench.scene
    motor = scene.motor_path()
    run = scene.layout.gather(np.broadcast_to(np.arange(scene.layout.rows.shape[1], dtype=float), scene.layout.rows.shape), len(scene))
    direction = np.stack([travel_direction(c, run.astype(np.int64)) for c in motor.T], axis=1)
    nominal = bench.predict()
    labels = [m.candidate.label for m in members]
    changes = [bench.predict([m.effect]) - nominal for m in members]
    return Evidence(
        before=bench.residual(),
        after=bench.residual([m.effect for m in members]),
        motor=bench.means(motor),
        direction=bench.means(direction),
        joint=tuple(c.index if c.joint else -1 for c in scene.channels),
        sealed=bench.part == 2,
        correlation=_correlation(state, changes),
        labels=tuple(labels),
        waterfall=state.waterfall,
    )


def _correlation(state: Search, changes: Sequence[FloatArray]) -> FloatArray:
    """Cosines between whitened signatures."""
    if not changes:
        return np.zeros((0, 0))
    seen = state.lens.look(np.stack(changes, axis=2))
    size = np.linalg.norm(seen, axis=0)
    cosine: FloatArray = seen.T @ seen / np.maximum(np.outer(size, size), 1e-300)
    return cosine


def _provenance(
    log: CalibrationLog, settings: RunSettings, data: _Data, state: Search, before: Localisation, seconds: float
) -> dict[str, Any]:
    bench = data.bench
    return {
        "data": [{"name": log.name, "sha256": log.digest, "rows": len(log)}],
        "seed": settings.seed,
        "versions": {
            "gpcorrect": gpcorrect.__version__ if hasattr(gpcorrect, "__version__") else "",
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "thresholds": {
            "localisation_nats": before.threshold,
            "effect_nats": penalty(max(state.n_kinds, 1)),
            "exact_probability": EXACT,
            "rival_probability": STABLE,
        },
        "seconds": seconds,
        "noise": {
            c.name: {"white": n.white, "slow": n.slow, "time_constant": n.time_constant, "tail": n.tail, "basis": n.basis}
            for c, n in zip(bench.scene.channels, state.lens.noises, strict=True)
        },
        "remarks": [*data.remarks, *_model_remarks(bench.scene)],
        "no_trace": list(state.silent),
    }


def _model_remarks(scene: Scene) -> list[str]:
    model = scene.model
    absent = [name for name in ("controller", "transmission", "links", "noise", "T_tracker_base") if getattr(model, name) is None]
    if not absent:
        return []
    return [f"absent from the model file, taken from the arm's description or from the data: {', '.join(absent)}"]
