"""Recordings that could be made next: short plans of each kind of run, inside the range in which the arm has moved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpcorrect.sim.effects import Run
from gpcorrect.sim.plan import Plan, Segment, minimum_jerk, plan_of
from gpcorrect.types import FloatArray

LADDER = (0.8, 2.0, 5.0, 12.0)  # s a stroke
AMPLITUDES = (1.0, 0.5, 0.2, 0.08)  # of the half range
STROKE = 2.5  # s
HOLD = 20.0  # s
EXTRA_LOAD = 0.3  # kg
GAIN = 0.5  # times the present gains
RETURNS, EVERY = 7, 120.0  # visits of the reference pose, and seconds from one to the next
SETUP = 2.0  # minutes to change payload or gains, or to home again
WIGGLE = 0.05  # of the range, at the reference pose


@dataclass(frozen=True, eq=False)
class Site:
    """What a run is made for.

    Parameters
    ----------
    ranges : (dof, 2) array
        In which the joints have moved, rad or m.
    types : str
        "R" or "P" for each.
    column : int or None
        Joint in question; None for all.
    rate_hz : float
        Of the recording.
    loads : bool
        Whether masses and poses are known, so that loads can be simulated.
    servo : bool
        Whether the closed loop is.
    """

    ranges: FloatArray
    types: str
    column: int | None
    rate_hz: float
    loads: bool
    servo: bool

    @property
    def middle(self) -> FloatArray:
        """(dof,) centre of the ranges."""
        centre: FloatArray = self.ranges.mean(axis=1)
        return centre

    @property
    def half(self) -> FloatArray:
        """(dof,) half width of the ranges."""
        width: FloatArray = 0.5 * np.ptp(self.ranges, axis=1)
        return width

    def moving(self) -> FloatArray:
        """(dof,) 1 for the joint in question, or for all."""
        every = np.ones(len(self.ranges))
        return every if self.column is None else (np.arange(len(every)) == self.column).astype(np.float64)


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A run: its recordings, each with the model that is then true of the controller.

    Parameters
    ----------
    run : Run
        Which kind.
    words : str
        What to do.
    plans : tuple of (Plan, float)
        Desired paths, and by which factor the controller's gains are changed.
    minutes : float
        How long it takes, changes of payload and gains included.
    sessions : int
        Homings in it.
    """

    run: Run
    words: str
    plans: tuple[tuple[Plan, float], ...]
    minutes: float
    sessions: int = 1


def planned_runs(site: Site, wanted: Sequence[Run]) -> list[PlannedRun]:
    """Return the runs of these kinds that can be made, and simulated, at this site.

    Parameters
    ----------
    site : Site
        What they are made for.
    wanted : sequence of Run
        Kinds.
    """
    made = [MAKERS[run](site) for run in wanted if run in MAKERS]
    return [planned for planned in made if planned is not None]


def _ladder(site: Site) -> list[FloatArray]:
    step = site.half * site.moving()
    return [_tour(site, [site.middle - step, site.middle + step, site.middle - step], s) for s in LADDER]


def _speed_ladder(site: Site) -> PlannedRun:
    words = f"{Run.SPEED_LADDER.value}: {_who(site)} over the range, strokes of {', '.join(f'{s:g}' for s in LADDER)} s"
    return _future(site, Run.SPEED_LADDER, words, [(p, None) for p in _ladder(site)])


def _amplitudes(site: Site) -> PlannedRun:
    fractions = ", ".join(f"{100 * a:g}" for a in AMPLITUDES)
    words = f"{Run.AMPLITUDES.value}: {_who(site)}, {fractions} % of the range"
    return _future(site, Run.AMPLITUDES, words, [(p, None) for p in _strokes(site)])


def _strokes(site: Site) -> list[FloatArray]:
    step = site.half * site.moving()
    paths = []
    for fraction in AMPLITUDES:
        low, high = site.middle - fraction * step, site.middle + fraction * step
        paths.append(_tour(site, [site.middle, high, low, high, low, site.middle], STROKE))
    return paths


def _hold_unload(site: Site) -> PlannedRun:
    step = site.half * site.moving()
    path = _tour(site, [site.middle - step, site.middle + step, site.middle - step], STROKE, rest=HOLD)
    words = f"{Run.HOLD_UNLOAD.value}: {_who(site)} to one end, hold {HOLD:g} s, back, hold again"
    loads = (EXTRA_LOAD, 0.0) if site.loads else (None,)
    return _future(site, Run.HOLD_UNLOAD, words, [(path, load) for load in loads])


def _load_swap(site: Site) -> PlannedRun | None:
    if not site.loads:
        return None
    words = f"{Run.LOAD_SWAP.value}: the same strokes without and with {EXTRA_LOAD:g} kg at the tip"
    return _future(site, Run.LOAD_SWAP, words, [(p, load) for load in (0.0, EXTRA_LOAD) for p in _strokes(site)[:2]])


def _one_joint(site: Site) -> PlannedRun | None:
    dof = len(site.ranges)
    if dof < 2:
        return None
    paths = []
    for j in range(dof):
        step = site.half * (np.arange(dof) == j)
        paths.append(_tour(site, [site.middle, site.middle + step, site.middle - step, site.middle], STROKE))
    return _future(site, Run.ONE_JOINT, f"{Run.ONE_JOINT.value}: each joint in turn", [(p, None) for p in paths])


def _pose_spread(site: Site) -> PlannedRun | None:
    if site.column is None or len(site.ranges) < 2:
        return None
    step, others = site.half * site.moving(), site.half * (1.0 - site.moving())
    paths = [
        _tour(site, [c - step, c + step, c - step], STROKE)
        for c in (site.middle - others, site.middle, site.middle + others)
    ]
    return _future(
        site, Run.POSE_SPREAD, f"{Run.POSE_SPREAD.value}: {_who(site)} sweeps at three", [(p, None) for p in paths]
    )


def _gain_change(site: Site) -> PlannedRun | None:
    if not site.servo:
        return None
    plan, seconds = _plan(site, [(p, None) for p in _ladder(site)])
    words = f"{Run.GAIN_CHANGE.value}: the speed ladder with the present gains and with {100 * GAIN:g} % of them"
    return PlannedRun(Run.GAIN_CHANGE, words, ((plan, 1.0), (plan, GAIN)), 2 * seconds / 60 + SETUP)


def _rehoming(site: Site) -> PlannedRun:
    pieces = [(p, None) for p in _strokes(site)[:2]]
    plan, seconds = _plan(site, [*pieces, *pieces], session=lambda i: i // len(pieces))
    words = f"{Run.REHOMING.value}: the same strokes before and after a homing"
    return PlannedRun(Run.REHOMING, words, ((plan, 1.0),), seconds / 60 + SETUP, sessions=2)


def _returns(site: Site) -> PlannedRun:
    pose = [site.middle, site.middle + WIGGLE * site.half, site.middle]
    pieces = [(_tour(site, pose, 1.0), None)] * RETURNS
    plan, _ = _plan(site, pieces, start=lambda i: i * EVERY)
    words = f"{Run.REFERENCE_RETURNS.value}: {RETURNS} times, every {EVERY / 60:g} minutes, working in between"
    return PlannedRun(Run.REFERENCE_RETURNS, words, ((plan, 1.0),), RETURNS * EVERY / 60)


def _two_insertions(site: Site) -> PlannedRun | None:
    if not site.loads or "P" not in site.types:
        return None
    insertion = site.types.index("P")
    step = site.half * site.moving() * (np.arange(len(site.ranges)) != insertion)
    depth = 0.9 * site.half * (np.arange(len(site.ranges)) == insertion)
    paths = [_tour(site, [c - step, c + step, c - step], STROKE) for c in (site.middle - depth, site.middle + depth)]
    return _future(site, Run.TWO_INSERTIONS, Run.TWO_INSERTIONS.value, [(p, None) for p in paths])


MAKERS: dict[Run, Callable[[Site], PlannedRun | None]] = {
    Run.SPEED_LADDER: _speed_ladder,
    Run.AMPLITUDES: _amplitudes,
    Run.HOLD_UNLOAD: _hold_unload,
    Run.LOAD_SWAP: _load_swap,
    Run.ONE_JOINT: _one_joint,
    Run.POSE_SPREAD: _pose_spread,
    Run.GAIN_CHANGE: _gain_change,
    Run.REHOMING: _rehoming,
    Run.REFERENCE_RETURNS: _returns,
    Run.TWO_INSERTIONS: _two_insertions,
}


def _who(site: Site) -> str:
    return "all joints together" if site.column is None else "the joint alone"


def _tour(site: Site, stops: Sequence[FloatArray], seconds: float, rest: float = 0.3) -> FloatArray:
    """Path `(n, dof)` through stops by minimum-jerk moves, with a rest at each."""
    parts = [stops[0][None]]
    pause = max(1, round(rest * site.rate_hz))
    for a, b in pairwise(stops):
        law = minimum_jerk(max(seconds, 2.0 / site.rate_hz), site.rate_hz)[1:, None]
        parts += [a + law * (b - a), np.repeat(b[None], pause, axis=0)]
    return np.concatenate(parts)


def _future(site: Site, run: Run, words: str, pieces: Sequence[tuple[FloatArray, float | None]]) -> PlannedRun:
    plan, seconds = _plan(site, pieces)
    changes = len({payload for _, payload in pieces}) - 1
    return PlannedRun(run, words, ((plan, 1.0),), seconds / 60 + SETUP * changes)


def _plan(
    site: Site,
    pieces: Sequence[tuple[FloatArray, float | None]],
    *,
    session: Callable[[int], int] = lambda i: 0,
    start: Callable[[int], float] | None = None,
) -> tuple[Plan, float]:
    """Pieces one after the other, a trajectory each, and the seconds that they take."""
    segments, clock = [], 0.0
    for i, (path, payload) in enumerate(pieces):
        begin = clock if start is None else start(i)
        segments.append(Segment(path, np.full(len(path), i), session(i), begin, payload))
        clock += len(path) / site.rate_hz
    return plan_of(segments, site.rate_hz), clock
