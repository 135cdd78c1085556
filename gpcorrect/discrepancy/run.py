"""The workflow: split, localise, search, name, add, and figures on the part that nothing has seen."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.discrepancy.advice.next_experiment import advise
from gpcorrect.discrepancy.evidence.lens import estimate_noises, lens_on
from gpcorrect.discrepancy.naming.intervals import half_widths
from gpcorrect.discrepancy.naming.named import Named
from gpcorrect.discrepancy.naming.prune import name_members
from gpcorrect.discrepancy.naming.sensor_noise import noise_effects
from gpcorrect.discrepancy.outcome.figures import evidence_of, gaps_of
from gpcorrect.discrepancy.outcome.kept import named, searched
from gpcorrect.discrepancy.outcome.provenance import provenance_of
from gpcorrect.discrepancy.outcome.result import Discrepancy, NamedEffect
from gpcorrect.discrepancy.outcome.store import StageStore
from gpcorrect.discrepancy.outcome.verdict import verdict
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.stated import samples_a_row
from gpcorrect.discrepancy.search.candidates import Candidate, Member, all_candidates, describe
from gpcorrect.discrepancy.search.laid import Laid, lay_out, localise_residual
from gpcorrect.discrepancy.search.needs import split_by_needs
from gpcorrect.discrepancy.search.score import search
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.discrepancy.search.trial import refine
from gpcorrect.sim.effects import in_order
from gpcorrect.sim.model import Model
from gpcorrect.types import BoolArray, CalibrationLog, Progress

__all__ = ["RunSettings", "find_discrepancy"]


EVALUATIONS = 30  # of the final refit


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


def find_discrepancy(
    log: CalibrationLog,
    model: Model,
    settings: RunSettings | None = None,
    progress: Progress | None = None,
    store: StageStore | None = None,
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
    store : StageStore, optional
        Keeps the finished search and its names, so that a run that was killed need not look for them again.

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
    progress.step("laying out", 0.0)
    laid = lay_out(log, model, settings.max_rows, rng)
    bench = laid.bench
    progress.step("laying out", 1.0)
    progress.step("localising", 0.0)
    before = localise_residual(laid, (), estimate_noises(bench, bench.residual(), bench.seen), settings.tolerance, rng)
    progress.step("localising", 1.0)
    candidates, lacks = split_by_needs(all_candidates(bench.scene), bench.scene, laid.log)
    state, kept, dropped = _search(laid, candidates if before.worth_a_search else [], settings, progress, store)
    progress.step("numbers", 0.0)
    members = _refit(state, [n.member for n in kept], bench.seen)
    effects = _with_numbers(state, kept, members, bench.seen)
    progress.step("numbers", 1.0)
    final = estimate_noises(bench, state.residual(members), bench.seen)
    noise, doubtful = _on_noise(bench, members, final)
    remainder = localise_residual(laid, members, final, settings.tolerance, rng) if before.worth_a_search else None
    progress.step("what is left", 1.0)
    progress.step("sealed part", 0.0)
    gap = gaps_of(laid, members, final, rng)
    progress.step("sealed part", 1.0)
    level = verdict(laid, state, before, (*effects, *noise), members, dropped)
    progress.step("next experiment", 0.0)
    advice = advise(bench.scene, members, [*kept, *dropped], final, settings.seed)
    progress.step("next experiment", 1.0)
    return Discrepancy(
        level=level,
        effects=(*effects, *noise),
        unnamed=(*dropped, *doubtful),
        localisation=before,
        remainder=remainder,
        gap=gap,
        next_experiment=advice,
        model=model.with_effects(*in_order((*model.effects, *(e.named.member.effect for e in (*effects, *noise))))),
        evidence=evidence_of(laid, state, members),
        provenance=provenance_of(log, settings.seed, laid, state, before, lacks, time.monotonic() - started),
    )


def _search(
    laid: Laid,
    candidates: Sequence[Candidate],
    settings: RunSettings,
    progress: Progress,
    store: StageStore | None,
) -> tuple[Search, tuple[Named, ...], tuple[Named, ...]]:
    """Search and naming, when there is something to name."""
    state = start_search(laid.bench, candidates, progress=progress)
    if not state.traces:
        return state, (), ()
    state = searched(state, candidates, store, lambda start: search(start, rounds=settings.rounds, progress=progress))
    return named(state, candidates, store, lambda done: name_members(done, laid.tests, laid.inputs, progress=progress))


def _refit(state: Search, members: Sequence[Member], rows: BoolArray) -> tuple[Member, ...]:
    """Estimate all numbers anew on these rows, together where effects show in common channels."""
    if not members:
        return ()
    bench = state.bench
    residual = state.residual(members)
    lens = lens_on(bench, residual, rows, estimate_noises(bench, residual, rows))
    done = list(members)
    for group in _groups(state, members):
        fixed = [m for i, m in enumerate(done) if i not in group]
        fresh = refine(bench, lens, state.observed, fixed, [done[i] for i in group], EVALUATIONS)
        for i, member in zip(group, fresh, strict=True):
            done[i] = member.canonical()
    return tuple(done)


def _on_noise(
    bench: Bench, members: Sequence[Member], noises: Sequence[ChannelNoise]
) -> tuple[tuple[NamedEffect, ...], tuple[Named, ...]]:
    """Return effects that change no mean, and those that are not sure enough to be named."""
    level = np.array([n.std for n in noises]) * np.sqrt(samples_a_row(bench.group))
    found = noise_effects(bench, [m.effect for m in members], level)
    sure = tuple(NamedEffect(e.named, e.parameters) for e in found if e.named.may_be_named)
    return sure, tuple(e.named for e in found if not e.named.may_be_named)


def _groups(state: Search, members: Sequence[Member]) -> list[list[int]]:
    """Return indices of members that are linked by common channels."""
    groups: list[list[int]] = []
    for i, member in enumerate(members):
        linked = [g for g in groups if any(state.alike(members[k].candidate, member.candidate) for k in g)]
        groups = [g for g in groups if g not in linked] + [[k for g in linked for k in g] + [i]]
    return groups


def _with_numbers(
    state: Search, kept: Sequence[Named], members: Sequence[Member], rows: BoolArray
) -> tuple[NamedEffect, ...]:
    if not members:
        return ()
    residual = state.residual(members)
    lens = lens_on(state.bench, residual, rows, estimate_noises(state.bench, residual, rows))
    found = []
    for i, (name, member) in enumerate(zip(kept, members, strict=True)):
        widths = half_widths(state, lens, members, i)
        found.append(NamedEffect(replace(name, member=member), describe(member, widths)))
    return tuple(sorted(found, key=lambda e: -e.named.nats))
