"""The workflow: split, localise, search, name, add, and figures on the test set, which nothing has seen.

But for the instant of a slip: where the other parts leave it open, the test set says where it lies.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from gpcorrect.discrepancy.advice import advise
from gpcorrect.discrepancy.evidence.bursts import Burst, bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.evidence.whitener import estimate_noises
from gpcorrect.discrepancy.naming.numbers import Numbers, estimate_numbers
from gpcorrect.discrepancy.naming.posterior import Level, Named
from gpcorrect.discrepancy.naming.selection import name_effects, name_rare
from gpcorrect.discrepancy.naming.sensor_noise import NoiseEffect, noise_effects
from gpcorrect.discrepancy.outcome.figures import evidence_of, gaps_of
from gpcorrect.discrepancy.outcome.provenance import provenance_of
from gpcorrect.discrepancy.outcome.result import ChannelGap, DiscrepancyResult, NamedEffect, UnnamedEffect, Verdict
from gpcorrect.discrepancy.outcome.store import StageStore, inputs_key, load_or_run
from gpcorrect.discrepancy.outcome.verdict import closed_where_they_show, headline, place_verdicts, verdict_level
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates, describe
from gpcorrect.discrepancy.search.needs import split_by_needs
from gpcorrect.discrepancy.search.prepared import PreparedData, localise_residual, open_beginnings, prepare_data
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.logs.join import join_logs
from gpcorrect.logs.validate import refuse_misread
from gpcorrect.sim.effects import in_order
from gpcorrect.sim.model import Model, model_key
from gpcorrect.types import CalibrationLog, Progress


def find_discrepancy(
    model: Model,
    logs: CalibrationLog | Sequence[CalibrationLog],
    *,
    seed: int = 0,
    progress: Progress | None = None,
    stages: Path | None = None,
) -> DiscrepancyResult:
    """Find where a model and recordings disagree, name what is missing, add it, and measure what that closes.

    Parameters
    ----------
    model : Model
        What is known of the machine, with the effects it already has.
    logs : CalibrationLog or sequence of CalibrationLog
        Recordings of one machine, with the motor side (measured_jp, setpoint_jp or poses) and an outside signal
        (external_jp or tracker_cp).
    seed : int
        Of the split and of everything drawn: the same inputs and seed give the same result.
    progress : Progress, optional
        Reported every stage.
    stages : Path, optional
        Folder for finished stages: a run that was killed goes on from there, a finished one is read back. Stages of
        other inputs count as absent, and are overwritten.

    Raises
    ------
    LogError
        Its joints, poses or stamps cannot be in the units, signs and columns that they are taken for.
    DataError
        A log lacks a needed signal or a clock that runs, or is too short to split.
    """
    log = logs if isinstance(logs, CalibrationLog) else join_logs(logs)
    refuse_misread(log, log.signals)
    _refuse_still_clock(log)
    store = None
    if stages is not None:
        key = inputs_key(log.digest, len(log), model_key(model), seed, version("gpcorrect"))
        store = StageStore(stages, key)
        if (finished := store.load_result()) is not None:
            return finished
    result = _find(model, log, seed, progress or Progress(), store)
    if store is not None:
        store.save_result(result)
    return result


def _refuse_still_clock(log: CalibrationLog) -> None:
    """Refuse a log whose stamps do not rise: no reader need have looked at one from Python."""
    step = np.diff(log.time)[np.diff(log.trajectory) == 0]
    if log.static or not (step > 0).any() or not (step >= 0).all():
        odd = "has no clock" if log.static else "has a clock that stands still, runs back or is missing"
        raise DataError(
            f"the log {odd} inside its trajectories: what moves cannot be told from what does not.",
            hint="Log `time` in seconds, rising within each trajectory.",
        )


def _find(
    model: Model, log: CalibrationLog, seed: int, progress: Progress, store: StageStore | None
) -> DiscrepancyResult:
    started, rng = time.monotonic(), np.random.default_rng(seed)
    progress.step("preparing", 0.0)
    prepared = prepare_data(log, model, rng)
    dataset = prepared.dataset
    progress.step("preparing", 1.0)
    progress.step("localising", 0.0)
    noises = estimate_noises(dataset, dataset.residual(), dataset.training)
    before = localise_residual(prepared, (), noises, rng)
    progress.step("localising", 1.0)
    candidates, lacks = split_by_needs(all_candidates(dataset.scene), dataset.scene, prepared.log)
    state = start_search(dataset, candidates if before.worth_a_search else [], progress)
    named: tuple[Named, ...] = ()
    dropped: tuple[Named, ...] = ()
    if state.traces:
        state, *_ = load_or_run(
            "search", state, candidates, store, lambda s: (search(s, rounds=SEARCH.rounds, progress=progress), (), ())
        )
        state, named, dropped = load_or_run(
            "naming", state, candidates, store, lambda s: name_effects(s, prepared, progress=progress)
        )
    prepared, state, named = name_rare(prepared, state, named, candidates, rng, progress)
    names = _Names(prepared, state, before, named, dropped)
    found = _judge(names, rng, progress, only_large=False)
    effects = found.verdict.effects
    if found.verdict.level == Level.UNKNOWN and effects and all(e.is_minor for e in effects):
        # What is too small to matter may well be a part of what has no name.
        found = _judge(names, rng, progress, only_large=True)
    names = found.names
    progress.step("next experiment", 0.0)
    advice = advise(names.prepared.dataset.scene, found.fitted, [*names.named, *names.dropped], found.noises)
    progress.step("next experiment", 1.0)
    provenance = provenance_of(log, seed, names.prepared, state, lacks, found.bursts, time.monotonic() - started)
    sure = [e.named.fit.effect for e in found.on_noise if e.named.may_be_named]
    added = [*(f.effect for f in found.fitted), *sure]
    return DiscrepancyResult(
        verdict=found.verdict,
        not_named=tuple(
            UnnamedEffect(n.fit.candidate.label, n.level, n.probability, n.nats, n.reasons)
            for n in (*names.dropped, *(e.named for e in found.on_noise if not e.named.may_be_named))
        ),
        localisation=before,
        remainder=found.remainder,
        gap=found.gap,
        next_experiment=advice.experiment,
        model=model.with_effects(*in_order((*model.effects, *added))),
        evidence=evidence_of(state, found.fitted),
        provenance=replace(provenance, remarks=(*provenance.remarks, *advice.remarks)),
        advised_plans=advice.plans,
    )


@dataclass(frozen=True, eq=False)
class _Names:
    """What search and naming came to."""

    prepared: PreparedData
    state: Search  # with the named effects
    before: Localisation  # of what the nominal model leaves
    named: tuple[Named, ...]
    dropped: tuple[Named, ...]  # what helped in the search, and may not be named


@dataclass(frozen=True, eq=False)
class _Judged:
    """What the named effects come to: their final numbers, what they leave, and the verdict."""

    names: _Names  # those that are in the model, and what has turned out unsure among the others
    fitted: tuple[FittedEffect, ...]
    on_noise: Sequence[NoiseEffect]
    noises: Sequence[ChannelNoise]
    remainder: Localisation | None
    gap: tuple[ChannelGap, ...]
    bursts: tuple[Burst, ...]
    verdict: Verdict


def _judge(names: _Names, rng: np.random.Generator, progress: Progress, *, only_large: bool) -> _Judged:
    """Estimate all numbers together, leave out what turns out unsure or minor, and look at what is left then."""
    prepared, state, named, dropped = names.prepared, names.state, names.named, names.dropped
    dataset = prepared.dataset
    progress.step("numbers", 0.0)
    numbers = estimate_numbers(state, [n.fit for n in named])
    found = _effects_of(state, named, numbers)
    minor: list[NamedEffect] = []
    while gone := {*numbers.unsure, *_minor(found, only_large)}:  # the rest is estimated again without them
        dropped += tuple(named[i].in_doubt() for i in numbers.unsure)
        minor += [e for i, e in found.items() if i in gone]
        stay = [i for i in range(len(named)) if i not in gone]
        named, numbers = tuple(named[i] for i in stay), estimate_numbers(state, [numbers.fitted[i] for i in stay])
        found = _effects_of(state, named, numbers)
    fitted = numbers.fitted
    progress.step("numbers", 1.0)
    shown = [f.effect for f in fitted]
    noises = estimate_noises(dataset, state.residual(fitted), dataset.training)
    on_noise = noise_effects(dataset, shown, np.array([n.std for n in noises]) * np.sqrt(dataset.samples_a_row))
    sure = [e for e in on_noise if e.named.may_be_named]
    prepared = prepared.without(open_beginnings(dataset, shown, noises))
    looked = names.before.worth_a_search or state.fitted
    remainder = localise_residual(prepared, fitted, noises, rng) if looked else None
    left = remainder or names.before
    progress.step("what is left", 1.0)
    progress.step("test set", 0.0)
    gap = gaps_of(prepared, fitted, noises, rng)
    progress.step("test set", 1.0)
    closes = closed_where_they_show(state, fitted, gap, left)
    closed = {i: replace(e, closes=c) for (i, e), c in zip(found.items(), closes, strict=True)}
    scene = dataset.scene  # what is a matter of the servo's steps, or may be, stays in the model, and has no name
    steps = [f.effect.is_a_matter_of_steps(scene.machine.drive, scene.joints) for f in fitted]
    of_steps = {i: e for i, e in closed.items() if steps[i] or named[i].like_steps}
    lasting = sorted((e for i, e in closed.items() if i not in of_steps), key=lambda e: -e.nats)
    effects, alike = ([e for e in lasting if e.is_a_name is named_so] for named_so in (True, False))
    effects += [NamedEffect.of(e.named, e.parameters) for e in sure]
    bursts = bursts_of(prepared.dataset, noises, shown)
    places = place_verdicts(effects, gap, left, bursts, alike)
    differs = names.before if lasting or not of_steps else left
    looked_at = (*dropped, *(named[i] for i in of_steps))
    level = verdict_level(prepared, state, differs, effects, alike, fitted, looked_at)
    level = headline(level, effects, alike, places)
    verdict = Verdict(level, tuple(effects), places, tuple(minor), tuple(alike), tuple(of_steps.values()))
    names = replace(names, prepared=prepared, named=named, dropped=dropped)
    return _Judged(names, fitted, on_noise, noises, remainder, gap, bursts, verdict)


def _effects_of(state: Search, named: Sequence[Named], numbers: Numbers) -> dict[int, NamedEffect]:
    """Return the effects with their estimates, by their place in the set: all but those that may be nothing."""
    if not named:
        return {}
    dataset = state.dataset
    whole = dataset.strict()  # what the tolerance takes up of an effect is a part of its size
    nominal, found = whole.predict(), {}
    for i, (name, fit) in enumerate(zip(named, numbers.fitted, strict=True)):
        if i in numbers.unsure:
            continue
        sizes = np.sqrt(np.mean((whole.predict([fit.effect]) - nominal) ** 2, axis=0)) / numbers.std
        shown = dataset.scene.channels[int(sizes.argmax())]
        found[i] = NamedEffect.of(
            replace(name, fit=fit),
            describe(fit, numbers.ends[i]),
            float(sizes.max()),
            of_motor=shown.signal == "measured_jp",
        )
    return found


def _minor(found: Mapping[int, NamedEffect], only_large: bool) -> list[int]:
    """Return effects too small to matter beside what is larger, for they may well be a part of it.

    What shows in the motors alone is left out by itself: the noise taken there is by definition what does not matter,
    and encoders tell a hundredth of it from nothing, such as two simulators that take their steps in another order.
    """
    small = [i for i, e in found.items() if e.is_minor]
    return small if only_large or len(small) < len(found) else [i for i in small if found[i].of_motor]
