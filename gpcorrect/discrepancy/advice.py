"""What to record next: the run with the largest expected evidence between two names, the rival refitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from scipy.optimize import least_squares

from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener, whitener_on
from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level, Named
from gpcorrect.discrepancy.outcome.result import Experiment
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.dataset import build_dataset
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.split import Split
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.settings import ADVICE, SPLIT
from gpcorrect.errors import DataError, GpCorrectError
from gpcorrect.sim import Noise, TrackerFaults, effect_from_dict, machine_of, simulate
from gpcorrect.sim.effects import Effect, Run
from gpcorrect.sim.effects.dynamics import GainError
from gpcorrect.sim.plan import Plan, Segment, minimum_jerk, plan_of
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray

STEP = 0.02  # of a coordinate, for slopes
EVALUATIONS = 6  # of a refit: the rival starts near, and only the order of magnitude counts
BULK = (2.0, 98.0)  # percentiles of the motor path: the range that runs stay in
Plans = tuple[tuple[Plan, float], ...]
View = tuple[DatasetWhitener, FloatArray]  # a recording of a run, and its channels `(m, c)` if the leader is true
REHOMED = {"R": 5e-3, "P": 5e-4}  # by which a homing moves a joint's zero
# Of the runs, inside the range in which the arm has moved.
LADDER = (0.8, 2.0, 5.0, 12.0)  # s a stroke
AMPLITUDES = (1.0, 0.5, 0.2, 0.08)  # of the half range
STROKE, REST = 2.5, 0.3  # s of a stroke, and at its ends
HOLD = 20.0  # s
EXTRA_LOAD = 0.3  # kg
GAIN = 0.5  # times the present gains
RETURNS, EVERY = 7, 120.0  # visits of the reference pose, and seconds from one to the next
SETUP = 2.0  # minutes to change payload or gains, or to home again
WIGGLE = 0.05  # of the range, at the reference pose


@dataclass(frozen=True, eq=False)
class Advice:
    """What to record next."""

    experiment: Experiment | None = None  # None where nothing is open, or nothing can be said
    plans: Plans = ()  # its desired paths, each with the factor on the controller's gains; none where it is a sensor
    remarks: tuple[str, ...] = ()  # what could not be said, and why


def advise(
    scene: Scene, fitted: Sequence[FittedEffect], named: Sequence[Named], noises: Sequence[ChannelNoise]
) -> Advice:
    """Find the run that tells the two leaders apart whose question is the most open; a remark where that fails.

    It simulates an arm in motions that nobody recorded. Whatever goes wrong there takes no answer with it.

    Parameters
    ----------
    scene : Scene, the recording that there is
    fitted : sequence of FittedEffect, effects that were named
    named : sequence of Named, all that were weighed, with their alternatives
    noises : sequence of ChannelNoise
    """
    question = _question(named)
    if question is None:
        return Advice()
    leader, rival = question
    try:
        return _advice(scene, fitted, leader, rival, noises)
    except Exception as error:  # noqa: BLE001  # a motion that nobody recorded may fail in any way
        names = f"{leader.fit.candidate.label} from {rival.label}"
        why = str(error) if isinstance(error, GpCorrectError) else repr(error)
        return Advice(remarks=(f"no run is advised that would tell {names}: to look for one failed ({why})",))


def _advice(
    scene: Scene, fitted: Sequence[FittedEffect], leader: Named, rival: Alternative, noises: Sequence[ChannelNoise]
) -> Advice:
    own = leader.fit.candidate
    rest = tuple(m.effect for m in fitted if m.candidate.key != own.key)
    shapes = tuple(c for c in all_candidates(scene) if c.label == rival.label)
    comparison = Comparison(scene, rest, leader.fit, shapes, tuple(noises))
    runs = list(dict.fromkeys(run for c in (own, *shapes[:1]) for run in c.kind.about.separating_runs))
    best = _best(comparison, runs)
    if best is None or best[1] < ADVICE.enough:
        tried = (best, _best(comparison, [run for run in Run if run not in runs]))
        best = max((t for t in tried if t is not None), key=lambda t: t[1], default=None)
    if best is None:
        return Advice()
    planned, nats = best
    enough = nats >= ADVICE.enough
    words = planned.words if enough else _sensor(scene, own)
    experiment = Experiment(words, enough, (own.label, rival.label), nats, planned.minutes)
    return Advice(experiment, planned.plans if enough else ())


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two explanations of one recording."""

    scene: Scene
    rest: tuple[Effect, ...]  # which both have
    leader: FittedEffect  # taken for true
    rivals: tuple[Candidate, ...]  # shape variants of one; none for "nothing"
    noises: tuple[ChannelNoise, ...]


def _question(named: Sequence[Named]) -> tuple[Named, Alternative] | None:
    """Return the most open effect with its best alternative: among rivals, else, if no name holds, among all."""
    asked = [n for n in named if n.level in (Level.CLASS, Level.SET)]
    if not asked and not any(n.level == Level.EXACT for n in named):
        asked = list(named)
    pairs = [(n, a) for n in asked for a in n.alternatives if a.label != n.fit.candidate.label]
    simulated = [(n, a) for n, a in pairs if a.explanation != Explanation.UNKNOWN]
    open_ones = [(n, a) for n, a in simulated if a.probability >= ADVICE.open_probability]
    return max(open_ones, key=lambda pair: pair[1].probability * pair[0].nats, default=None)


def _site(scene: Scene, joint: int | str) -> Site:
    body = scene.machine.body
    return Site(
        ranges=np.percentile(scene.motor_path(), BULK, axis=0).T,
        types=body.types,
        column=scene.joints.index(joint) if isinstance(joint, int) else None,
        rate_hz=1.0 / scene.step,
        loads=body.chain is not None,
        servo=scene.plan is not None,
    )


def _best(comparison: Comparison, runs: Sequence[Run]) -> tuple[PlannedRun, float] | None:
    """Return the run with the most expected evidence, half the whitened squares between leader and refitted rival.

    Only the run counts, not what the present recording says of the rival's numbers: the true gain is at least this. The
    rival's first shape chooses; its others then have their say.
    """
    best: tuple[PlannedRun, float] | None = None
    views: list[View] = []
    for planned in planned_runs(_site(comparison.scene, comparison.leader.candidate.joint), runs):
        seen = [_view(comparison, planned, plan, gain) for plan, gain in planned.plans]
        nats = _evidence(comparison, seen, comparison.rivals[:1])
        if best is None or nats > best[1]:
            best, views = (planned, nats), seen
    if best is None or len(comparison.rivals) < 2 or best[1] < ADVICE.enough:
        return best
    return best[0], min(best[1], _evidence(comparison, views, comparison.rivals[1:]))


def _view(comparison: Comparison, planned: PlannedRun, plan: Plan, gain: float) -> View:
    """One recording of a run as it would be seen if the leader were true."""
    model = comparison.scene.model
    # A robot file's servo may stand in the file alone, so gains are lowered as an effect would.
    lowered = tuple(GainError(n, gain - 1.0, gain - 1.0) for n in model.joints) if gain != 1.0 else ()
    quiet = model.with_effects(*model.effects, *lowered)
    quiet = quiet.model_copy(update={"noise": Noise(), "faults": TrackerFaults()})
    log = _same_signals(simulate(machine_of(quiet.with_effects(*lowered)), plan), comparison.scene)
    scene = build_scene(log, quiet, np.ones(len(log), dtype=np.bool_), comparison.noises)
    effects = [*comparison.rest, _homed(comparison.leader.effect, comparison, planned)]
    scene = replace(scene, observed=scene.predict(effects))  # the tracker would be registered on what it then sees
    whole = Split(log.trajectory, np.zeros(len(log), dtype=np.int64), "")
    stride = max(1, int(np.ceil(len(comparison.scene) / SPLIT.most_rows)))  # as for the present recording
    dataset = build_dataset(scene, whole, max_rows=max(1, len(log) // stride))
    predicted = dataset.predict(effects)
    every = np.ones(len(dataset), dtype=np.bool_)
    return whitener_on(dataset, np.zeros(predicted.shape), every, comparison.noises), predicted


def _same_signals(log: CalibrationLog, scene: Scene) -> CalibrationLog:
    """Log without the signals that the present recording lacks."""
    seen = {c.signal for c in scene.channels}
    tracked = log.tracker_cp if "tracker_cp" in seen else None
    if tracked is not None and "tracker_rotation" not in seen:
        tracked = replace(tracked, quaternion=None)
    log = replace(log, tracker_cp=tracked, external_jp=log.external_jp if "external_jp" in seen else None)
    return log if "measured_jp" in seen else replace(log, measured_jp=None, measured_jv=None, measured_jf=None)


def _homed(effect: Effect, comparison: Comparison, planned: PlannedRun) -> Effect:
    """Return the leader with another value after a homing, where it has one a session."""
    single = [p for p in effect.about.parameters if p.per_session]
    if planned.sessions == 1 or not single:
        return effect
    name = single[0].name
    value = float(np.atleast_1d(getattr(effect, name))[0])
    scene = comparison.scene
    kind = scene.machine.body.types[scene.joints.index(effect.joint)] if effect.joint in scene.joints else "R"
    return effect_from_dict(effect.to_dict() | {name: [value, value + REHOMED[kind]]})


def _left(views: Sequence[View], effects: Sequence[Effect]) -> FloatArray:
    """Whitened residuals that effects leave in the recordings of a run."""
    return np.concatenate([w.whiten(predicted - w.dataset.predict(effects)) for w, predicted in views])


def _evidence(comparison: Comparison, views: Sequence[View], rivals: Sequence[Candidate]) -> float:
    """Half the squares that the best of the rivals leaves, its numbers fitted to the run; or that nothing does."""
    nothing = 0.5 * float((_left(views, comparison.rest) ** 2).sum())
    return min((_misfit(comparison, views, rival, nothing) for rival in rivals), default=nothing)


def _misfit(comparison: Comparison, views: Sequence[View], rival: Candidate, nothing: float) -> float:
    low, high = rival.bounds

    def errors(u: FloatArray) -> FloatArray:
        return _left(views, [*comparison.rest, rival.build(u)])

    def slopes(u: FloatArray) -> FloatArray:
        here, columns = errors(u), []
        for j in range(len(u)):
            step = STEP * max(abs(u[j]), 0.1) * (1.0 if u[j] + STEP < high[j] else -1.0)
            columns.append((errors(u + step * (np.arange(len(u)) == j)) - here) / step)
        return np.stack(columns, axis=1)

    inside = np.clip(rival.start, np.nextafter(low, high), np.nextafter(high, low))
    try:
        fit = least_squares(errors, inside, jac=slopes, bounds=(low, high), max_nfev=EVALUATIONS, ftol=1e-4)
    except DataError:  # the rival does not fit this run, such as two homings
        return nothing
    return float(fit.cost)


def _sensor(scene: Scene, own: Candidate) -> str:
    """Return what would have to be measured, when no run with the present sensors tells the two apart."""
    seen = {c.signal for c in scene.channels}
    where = f"joint {own.joint}" if isinstance(own.joint, int) else "each joint"
    if "external_jp" not in seen:
        sensor = f"an encoder behind the transmission of {where}"
    elif scene.effort is None:
        sensor = f"the motor effort of {where}"
    elif scene.machine.body.chain is None:
        sensor = "a tracker at the tool tip, with an arm whose kinematics are known"
    else:
        sensor = f"the cable force of {where}"
    return f"equivalent with these sensors, whatever is recorded: measure {sensor}"


@dataclass(frozen=True, eq=False)
class Site:
    """Where a run is made."""

    ranges: FloatArray  # (dof, 2) in which the joints have moved
    types: str
    column: int | None  # of the joint in question; None for all
    rate_hz: float
    loads: bool  # whether they can be simulated
    servo: bool  # the same of the closed loop

    @property
    def middle(self) -> FloatArray:
        """(dof,) centre of the ranges."""
        return np.asarray(self.ranges.mean(axis=1))

    @property
    def half(self) -> FloatArray:
        """(dof,) half width of the ranges."""
        return np.asarray(0.5 * np.ptp(self.ranges, axis=1))

    @property
    def moving(self) -> BoolArray:
        """(dof,) whether it is the joint in question, or all are."""
        return np.full(len(self.ranges), True) if self.column is None else np.arange(len(self.ranges)) == self.column


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A run in words and as desired paths."""

    run: Run
    words: str
    plans: tuple[tuple[Plan, float], ...]  # each with the factor by which the controller's gains are changed
    minutes: float  # with changes of payload and gains
    sessions: int  # homings in it


def planned_runs(site: Site, wanted: Sequence[Run]) -> list[PlannedRun]:
    """Return the short runs of these kinds that can be made, and simulated, at this site, inside its ranges.

    Parameters
    ----------
    site : Site
    wanted : sequence of Run
    """
    made = {planned.run: planned for planned in (*_motion_runs(site), *_special_runs(site))}
    return [made[run] for run in wanted if run in made]


def _motion_runs(site: Site) -> list[PlannedRun]:
    """Return the runs that need no other gains, homings or pauses."""
    middle, step, dof = site.middle, site.half * site.moving, len(site.ranges)
    who = "all joints together" if site.column is None else "the joint alone"
    fractions, seconds = ", ".join(f"{100 * a:g}" for a in AMPLITUDES), ", ".join(f"{s:g}" for s in LADDER)
    runs = [
        _run(site, Run.SPEED_LADDER, f": {who} over the range, strokes of {seconds} s", _ladder(site)),
        _run(site, Run.AMPLITUDES, f": {who}, {fractions} % of the range", _strokes(site)),
    ]
    if dof > 1:
        tours = [_tour(site, [middle, middle + own, middle - own, middle]) for own in np.diag(site.half)]
        runs.append(_run(site, Run.ONE_JOINT, ": each joint in turn", tours))
    if dof > 1 and site.column is not None:
        others = site.half * ~site.moving
        sweeps = [_sweep(site, centre, step) for centre in (middle - others, middle, middle + others)]
        runs.append(_run(site, Run.POSE_SPREAD, f": {who} sweeps at three", sweeps))
    hold, words = _sweep(site, middle, step, rest=HOLD), f": {who} to one end, hold {HOLD:g} s, back, hold again"
    loads = (EXTRA_LOAD, 0.0) if site.loads else (None,)
    return [*runs, _run(site, Run.HOLD_UNLOAD, words, [hold], loads=loads)]


def _special_runs(site: Site) -> list[PlannedRun]:
    """Return the runs with other payloads, gains, homings or pauses."""
    strokes = _strokes(site)[:2]
    runs = []
    if site.loads:
        words = f": the same strokes without and with {EXTRA_LOAD:g} kg at the tip"
        runs.append(_run(site, Run.LOAD_SWAP, words, strokes, loads=(0.0, EXTRA_LOAD)))
    if site.loads and "P" in site.types:
        insertion = np.arange(len(site.ranges)) == site.types.index("P")
        step, depth = site.half * (site.moving & ~insertion), 0.9 * site.half * insertion
        sweeps = [_sweep(site, centre, step) for centre in (site.middle - depth, site.middle + depth)]
        runs.append(_run(site, Run.TWO_INSERTIONS, "", sweeps))
    if site.servo:
        words = f": the speed ladder with the present gains and with {100 * GAIN:g} % of them"
        runs.append(_run(site, Run.GAIN_CHANGE, words, _ladder(site), gains=(1.0, GAIN)))
    words = ": the same strokes before and after a homing"
    runs.append(_run(site, Run.REHOMING, words, strokes * 2, sessions=2))
    visit = _tour(site, [site.middle, site.middle + WIGGLE * site.half, site.middle], 1.0)
    words = f": {RETURNS} times, every {EVERY / 60:g} minutes, working in between"
    return [*runs, _run(site, Run.REFERENCE_RETURNS, words, [visit] * RETURNS, every=EVERY)]


def _tour(site: Site, stops: Sequence[FloatArray], seconds: float = STROKE, rest: float = REST) -> FloatArray:
    """Path `(n, dof)` through stops by minimum-jerk moves of these seconds, with a rest at each."""
    parts = [stops[0][None]]
    pause = max(1, round(rest * site.rate_hz))
    for a, b in pairwise(stops):
        law = minimum_jerk(max(seconds, 2.0 / site.rate_hz), site.rate_hz)[1:, None]
        parts += [a + law * (b - a), np.repeat(b[None], pause, axis=0)]
    return np.concatenate(parts)


def _sweep(site: Site, centre: FloatArray, step: FloatArray, seconds: float = STROKE, rest: float = REST) -> FloatArray:
    return _tour(site, [centre - step, centre + step, centre - step], seconds, rest)


def _ladder(site: Site) -> list[FloatArray]:
    """Return the same stroke at ever lower speeds."""
    return [_sweep(site, site.middle, site.half * site.moving, seconds) for seconds in LADDER]


def _strokes(site: Site) -> list[FloatArray]:
    """Return strokes to both sides, at ever smaller amplitudes."""
    middle, steps = site.middle, [fraction * (site.half * site.moving) for fraction in AMPLITUDES]
    return [_tour(site, [middle, *[middle + step, middle - step] * 2, middle]) for step in steps]


def _run(
    site: Site,
    run: Run,
    words: str,
    paths: Sequence[FloatArray],
    *,
    loads: Sequence[float | None] = (None,),
    gains: Sequence[float] = (1.0,),
    sessions: int = 1,
    every: float | None = None,
) -> PlannedRun:
    """Paths one after the other, or one every so many seconds, a trajectory each: with each load, then each gain."""
    pieces = [(path, load) for load in loads for path in paths]
    lengths = [len(path) / site.rate_hz if every is None else every for path, _ in pieces]
    begin = [0.0, *accumulate(lengths[:-1])]
    segments = [
        Segment(path, np.full(len(path), i), i * sessions // len(pieces), begin[i], payload)
        for i, (path, payload) in enumerate(pieces)
    ]
    plan, changes = plan_of(segments, site.rate_hz), len(loads) + len(gains) + sessions - 3
    minutes = len(gains) * sum(lengths) / 60 + SETUP * changes
    return PlannedRun(run, f"{run}{words}", tuple((plan, gain) for gain in gains), minutes, sessions)
