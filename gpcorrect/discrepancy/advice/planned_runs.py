"""Recordings that could be made next: short plans of each kind of run, inside the range in which the arm has moved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

    @property
    def moving(self) -> BoolArray:
        """(dof,) whether it is the joint in question, or all are."""
        return np.full(len(self.ranges), True) if self.column is None else np.arange(len(self.ranges)) == self.column

    @property
    def who(self) -> str:
        """Words for what moves."""
        return "all joints together" if self.column is None else "the joint alone"

    def tour(self, stops: Sequence[FloatArray], seconds: float = STROKE, rest: float = REST) -> FloatArray:
        """Return a path `(n, dof)` through stops by minimum-jerk moves, with a rest at each.

        Parameters
        ----------
        stops : sequence of (dof,) arrays
        seconds, rest : float
            Of a move, and at a stop.
        """
        parts = [stops[0][None]]
        pause = max(1, round(rest * self.rate_hz))
        for a, b in pairwise(stops):
            law = minimum_jerk(max(seconds, 2.0 / self.rate_hz), self.rate_hz)[1:, None]
            parts += [a + law * (b - a), np.repeat(b[None], pause, axis=0)]
        return np.concatenate(parts)

    def sweep(self, centre: FloatArray, step: FloatArray, seconds: float = STROKE, rest: float = REST) -> FloatArray:
        """Return a path `(n, dof)` from one end to the other and back.

        Parameters
        ----------
        centre, step : (dof,) arrays
            Middle of the stroke, and half of it.
        seconds, rest : float
            Of a move, and at a stop.
        """
        return self.tour([centre - step, centre + step, centre - step], seconds, rest)


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
    made = [MAKERS[run](site) for run in wanted]
    return [planned for planned in made if planned is not None]


def _ladder(site: Site) -> list[Piece]:
    return [(site.sweep(site.middle, site.half * site.moving, seconds), None) for seconds in LADDER]


def _strokes(site: Site) -> list[Piece]:
    pieces: list[Piece] = []
    for fraction in AMPLITUDES:
        middle, step = site.middle, fraction * (site.half * site.moving)
        low, high = middle - step, middle + step
        pieces.append((site.tour([middle, high, low, high, low, middle]), None))
    return pieces


def _speed_ladder(site: Site) -> PlannedRun:
    strokes = ", ".join(f"{s:g}" for s in LADDER)
    return _run(site, Run.SPEED_LADDER, f": {site.who} over the range, strokes of {strokes} s", _ladder(site))


def _amplitudes(site: Site) -> PlannedRun:
    fractions = ", ".join(f"{100 * a:g}" for a in AMPLITUDES)
    return _run(site, Run.AMPLITUDES, f": {site.who}, {fractions} % of the range", _strokes(site))


def _hold_unload(site: Site) -> PlannedRun:
    path = site.sweep(site.middle, site.half * site.moving, rest=HOLD)
    pieces: list[Piece] = [(path, EXTRA_LOAD), (path, 0.0)] if site.loads else [(path, None)]
    return _run(site, Run.HOLD_UNLOAD, f": {site.who} to one end, hold {HOLD:g} s, back, hold again", pieces)


def _load_swap(site: Site) -> PlannedRun | None:
    if not site.loads:
        return None
    pieces: list[Piece] = [(path, load) for load in (0.0, EXTRA_LOAD) for path, _ in _strokes(site)[:2]]
    return _run(site, Run.LOAD_SWAP, f": the same strokes without and with {EXTRA_LOAD:g} kg at the tip", pieces)


def _one_joint(site: Site) -> PlannedRun | None:
    if len(site.ranges) < 2:
        return None
    middle = site.middle
    steps = np.diag(site.half)
    pieces: list[Piece] = [(site.tour([middle, middle + step, middle - step, middle]), None) for step in steps]
    return _run(site, Run.ONE_JOINT, ": each joint in turn", pieces)


def _pose_spread(site: Site) -> PlannedRun | None:
    if site.column is None or len(site.ranges) < 2:
        return None
    others = site.half * ~site.moving
    centres = (site.middle - others, site.middle, site.middle + others)
    pieces: list[Piece] = [(site.sweep(centre, site.half * site.moving), None) for centre in centres]
    return _run(site, Run.POSE_SPREAD, f": {site.who} sweeps at three", pieces)


def _gain_change(site: Site) -> PlannedRun | None:
    if not site.servo:
        return None
    plan, seconds = _plan(site, _ladder(site))
    words = f"{Run.GAIN_CHANGE.value}: the speed ladder with the present gains and with {100 * GAIN:g} % of them"
    return PlannedRun(Run.GAIN_CHANGE, words, ((plan, 1.0), (plan, GAIN)), 2 * seconds / 60 + SETUP)


def _rehoming(site: Site) -> PlannedRun:
    pieces = _strokes(site)[:2]
    plan, seconds = _plan(site, pieces * 2, session=[i // len(pieces) for i in range(2 * len(pieces))])
    words = f"{Run.REHOMING.value}: the same strokes before and after a homing"
    return PlannedRun(Run.REHOMING, words, ((plan, 1.0),), seconds / 60 + SETUP, sessions=2)


def _returns(site: Site) -> PlannedRun:
    visit: Piece = site.tour([site.middle, site.middle + WIGGLE * site.half, site.middle], 1.0), None
    plan, _ = _plan(site, [visit] * RETURNS, start=[i * EVERY for i in range(RETURNS)])
    words = f"{Run.REFERENCE_RETURNS.value}: {RETURNS} times, every {EVERY / 60:g} minutes, working in between"
    return PlannedRun(Run.REFERENCE_RETURNS, words, ((plan, 1.0),), RETURNS * EVERY / 60)


def _two_insertions(site: Site) -> PlannedRun | None:
    if not site.loads or "P" not in site.types:
        return None
    insertion = np.arange(len(site.ranges)) == site.types.index("P")
    step, depth = site.half * (site.moving & ~insertion), 0.9 * site.half * insertion
    pieces: list[Piece] = [(site.sweep(centre, step), None) for centre in (site.middle - depth, site.middle + depth)]
    return _run(site, Run.TWO_INSERTIONS, "", pieces)


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


def _run(site: Site, run: Run, words: str, pieces: Sequence[Piece]) -> PlannedRun:
    plan, seconds = _plan(site, pieces)
    changes = len({payload for _, payload in pieces}) - 1
    return PlannedRun(run, f"{run.value}{words}", ((plan, 1.0),), seconds / 60 + SETUP * changes)


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
