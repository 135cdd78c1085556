"""Recordings that could be made next: short plans of each kind of run, inside the range in which the arm has moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from gpcorrect.sim.effects import Run
from gpcorrect.sim.plan import Plan, Segment, minimum_jerk, plan_of
from gpcorrect.types import BoolArray, FloatArray

LADDER = (0.8, 2.0, 5.0, 12.0)  # s a stroke
AMPLITUDES = (1.0, 0.5, 0.2, 0.08)  # of the half range
STROKE, REST = 2.5, 0.3  # s of a stroke, and at its ends
HOLD = 20.0  # s
EXTRA_LOAD = 0.3  # kg
GAIN = 0.5  # times the present gains
RETURNS, EVERY = 7, 120.0  # visits of the reference pose, and seconds from one to the next
SETUP = 2.0  # minutes to change payload or gains, or to home again
WIGGLE = 0.05  # of the range, at the reference pose
Piece = tuple[FloatArray, float | None]  # path, and kg at the tip; None for the present ones


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
    sessions: int = 1  # homings in it


def planned_runs(site: Site, wanted: Sequence[Run]) -> list[PlannedRun]:
    """Return the runs of these kinds that can be made, and simulated, at this site.

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
        _run(site, Run.SPEED_LADDER, f": {who} over the range, strokes of {seconds} s", _bare(_ladder(site))),
        _run(site, Run.AMPLITUDES, f": {who}, {fractions} % of the range", _bare(_strokes(site))),
    ]
    if dof > 1:
        tours = [_tour(site, [middle, middle + own, middle - own, middle]) for own in np.diag(site.half)]
        runs.append(_run(site, Run.ONE_JOINT, ": each joint in turn", _bare(tours)))
    if dof > 1 and site.column is not None:
        others = site.half * ~site.moving
        sweeps = [_sweep(site, centre, step) for centre in (middle - others, middle, middle + others)]
        runs.append(_run(site, Run.POSE_SPREAD, f": {who} sweeps at three", _bare(sweeps)))
    hold = _sweep(site, middle, step, rest=HOLD)
    loads: Sequence[float | None] = (EXTRA_LOAD, 0.0) if site.loads else (None,)
    words = f": {who} to one end, hold {HOLD:g} s, back, hold again"
    return [*runs, _run(site, Run.HOLD_UNLOAD, words, [(hold, load) for load in loads])]


def _special_runs(site: Site) -> list[PlannedRun]:
    """Return the runs with other payloads, gains, homings or pauses."""
    strokes = _strokes(site)[:2]
    runs = []
    if site.loads:
        words = f": the same strokes without and with {EXTRA_LOAD:g} kg at the tip"
        pieces = [(path, load) for load in (0.0, EXTRA_LOAD) for path in strokes]
        runs.append(_run(site, Run.LOAD_SWAP, words, pieces))
    if site.loads and "P" in site.types:
        insertion = np.arange(len(site.ranges)) == site.types.index("P")
        step, depth = site.half * (site.moving & ~insertion), 0.9 * site.half * insertion
        sweeps = [_sweep(site, centre, step) for centre in (site.middle - depth, site.middle + depth)]
        runs.append(_run(site, Run.TWO_INSERTIONS, "", _bare(sweeps)))
    if site.servo:
        plan, seconds = _plan(site, _bare(_ladder(site)))
        words = f": the speed ladder with the present gains and with {100 * GAIN:g} % of them"
        plans = ((plan, 1.0), (plan, GAIN))
        runs.append(PlannedRun(Run.GAIN_CHANGE, f"{Run.GAIN_CHANGE}{words}", plans, 2 * seconds / 60 + SETUP))
    sessions = np.repeat([0, 1], len(strokes)).tolist()
    plan, seconds = _plan(site, _bare(strokes * 2), session=sessions)
    words = f"{Run.REHOMING}: the same strokes before and after a homing"
    runs.append(PlannedRun(Run.REHOMING, words, ((plan, 1.0),), seconds / 60 + SETUP, sessions=2))
    visit = _tour(site, [site.middle, site.middle + WIGGLE * site.half, site.middle], 1.0)
    plan, _ = _plan(site, _bare([visit] * RETURNS), start=[i * EVERY for i in range(RETURNS)])
    words = f"{Run.REFERENCE_RETURNS}: {RETURNS} times, every {EVERY / 60:g} minutes, working in between"
    return [*runs, PlannedRun(Run.REFERENCE_RETURNS, words, ((plan, 1.0),), RETURNS * EVERY / 60)]


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


def _bare(paths: Sequence[FloatArray]) -> list[Piece]:
    """Paths with the present payload."""
    return [(path, None) for path in paths]


def _run(site: Site, run: Run, words: str, pieces: Sequence[Piece]) -> PlannedRun:
    plan, seconds = _plan(site, pieces)
    changes = len({payload for _, payload in pieces}) - 1
    return PlannedRun(run, f"{run}{words}", ((plan, 1.0),), seconds / 60 + SETUP * changes)


def _plan(
    site: Site, pieces: Sequence[Piece], *, session: Sequence[int] | None = None, start: Sequence[float] | None = None
) -> tuple[Plan, float]:
    """Pieces one after the other, a trajectory each, and the seconds that they take."""
    lengths = [len(path) / site.rate_hz for path, _ in pieces]
    begin = start or [0.0, *accumulate(lengths[:-1])]
    sessions = session or [0] * len(pieces)
    segments = [
        Segment(path, np.full(len(path), i), sessions[i], begin[i], payload) for i, (path, payload) in enumerate(pieces)
    ]
    return plan_of(segments, site.rate_hz), sum(lengths)
