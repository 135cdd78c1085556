"""What may be missing: every effect of the catalogue on every joint it could act on. None is known here by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.coordinates import Coordinate, coordinate_of
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Candidate as Shape
from gpcorrect.sim.effects import Effect, Family, Scope
from gpcorrect.sim.effects import candidates as shapes
from gpcorrect.types import FloatArray

DETAILS = ("side", "law", "pause", "rest", "form", "place", "gains", "of")
HELD = 1e-4  # of a number that is held: a bounded fit needs some room


def watched(scene: Scene, session: int) -> tuple[float, float]:
    """Session time from a little into its first motion to the start of the last ones, s; inf, -inf for too few.

    Parameters
    ----------
    scene : Scene
    session : int, index of the session, from 0
    """
    here, time = scene.session == session, scene.layout.gather(scene.motion.time)
    motions = [time[here & (scene.trajectory == t)] for t in np.unique(scene.trajectory[here])]
    n = SEARCH.watched
    if len(motions) <= n:
        return np.inf, -np.inf
    return min(float(m.min()) for m in motions) + SEARCH.before, sorted(float(m.min()) for m in motions)[-n]


@dataclass(frozen=True)
class Candidate:
    """An effect on a joint, with its numbers still open."""

    kind: type[Effect]  # from the registry
    joint: int | str  # where it would act
    fixed: tuple[tuple[str, Any], ...]  # fields that are no numbers to estimate, such as a coupling's source
    coordinates: tuple[Coordinate, ...]  # numbers to estimate, one for each session where it has one a session
    start: tuple[float, ...]  # coordinates at which its signature is taken

    @property
    def name(self) -> str:
        """Canonical name of the effect."""
        return self.kind.about.name

    @property
    def family(self) -> str:
        """Its class in the catalogue."""
        return str(self.kind.about.family)

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Indices of the coordinates of every parameter that is estimated."""
        places: dict[str, list[int]] = {}
        for i, coordinate in enumerate(self.coordinates):
            places.setdefault(coordinate.parameter.name, []).append(i)
        return places

    @cached_property
    def amplitudes(self) -> tuple[int, ...]:
        """Indices of the coordinates that its trace simply grows with; none where its shape says all."""
        return tuple(i for i, c in enumerate(self.coordinates) if c.amplitude)

    @property
    def starts_as_it_is(self) -> bool:
        """Whether its first estimate is its start, whatever multiple of its change the data ask for."""
        return not self.amplitudes and self.coordinates[0].kind != "log"

    @property
    def instant(self) -> int | None:
        """Index of the coordinate that is a change-point, if there is one."""
        return next((i for i, c in enumerate(self.coordinates) if c.parameter.change_point), None)

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What it is, whatever its numbers: two fitted of a set with one key are one."""
        return (self.name, self.joint, self.fixed)

    def called_like(self, other: Candidate) -> bool:
        """Return whether a report gives both the same name, whatever the cable's side or the law of a hysteresis.

        Parameters
        ----------
        other : Candidate
        """
        own, others = ({k: v for k, v in c.fixed if k not in DETAILS} for c in (self, other))
        return (self.name, self.joint, own) == (other.name, other.joint, others)

    def may_be(self, effect: Effect) -> bool:
        """Return whether an effect is this one with some numbers.

        Parameters
        ----------
        effect : Effect
        """
        here = type(effect) is self.kind and effect.joint == self.joint
        return here and all(getattr(effect, name) == value for name, value in self.fixed)

    @property
    def label(self) -> str:
        """Words for tables and figures."""
        extra = "".join(f", {k} {v}" for k, v in self.fixed)
        return f"{self.name.replace('_', ' ')} ({self.joint}{extra})"

    @property
    def extra(self) -> int:
        """How many parameters it has beyond the first; one with a value a session counts once."""
        return len(self.places) - 1

    @property
    def sizes(self) -> tuple[int, ...]:
        """Indices of the coordinates that say how large it is."""
        return self.amplitudes or (0,)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the coordinates."""
        low, high = np.array([c.bounds for c in self.coordinates]).T
        return low, high

    def build(self, u: FloatArray) -> Effect:
        """Return the effect at coordinates.

        Parameters
        ----------
        u : array
        """
        values: dict[str, Any] = {}
        for name, places in self.places.items():
            numbers = [self.coordinates[i].value(float(u[i])) for i in places]
            values[name] = tuple(numbers) if len(numbers) > 1 else numbers[0]
        return self.kind(joint=self.joint, **dict(self.fixed), **values)

    def scaled(self, factors: FloatArray) -> FloatArray:
        """Return coordinates with the amplitudes at multiples of their start, inside the bounds; a shape stays.

        Of a shape that has no amplitude, but a width from nothing up, the width is at that multiple.

        Parameters
        ----------
        factors : array, one for each amplitude, or one for the whole
        """
        u = np.array(self.start)
        if not self.amplitudes and self.coordinates[0].kind == "log":
            u[0] += np.log(max(float(factors[0]), 1e-2))
        for i, factor in zip(self.amplitudes, factors, strict=False):
            base = self.coordinates[i].identity
            u[i] = base + factor * (u[i] - base)
        clipped: FloatArray = np.clip(u, *self.bounds)
        return clipped


@dataclass(frozen=True, eq=False)
class FittedEffect:
    """A candidate with its numbers."""

    candidate: Candidate
    u: FloatArray

    @cached_property
    def effect(self) -> Effect:
        """The effect."""
        return self.candidate.build(self.u)

    def moved(self, index: int, u: float) -> FittedEffect:
        """Return the effect with one coordinate at another place.

        Parameters
        ----------
        index : int
        u : float
        """
        moved = np.array(self.u)
        moved[index] = u
        return FittedEffect(self.candidate, moved)

    def pinned(self, index: int, u: float) -> FittedEffect:
        """Return the same effect with one coordinate held, at the nearest place within its bounds.

        Parameters
        ----------
        index : int
        u : float
        """
        coordinates = list(self.candidate.coordinates)
        low, high = coordinates[index].low, coordinates[index].high
        value = min(max(coordinates[index].value(u), low), high)
        room = HELD * (abs(value) or coordinates[index].typical)
        coordinates[index] = replace(coordinates[index], low=max(low, value - room), high=min(high, value + room))
        return FittedEffect(replace(self.candidate, coordinates=tuple(coordinates)), self.moved(index, u).u)

    def canonical(self) -> FittedEffect:
        """Return the same effect with its numbers in the one way to write them."""
        effect, coordinates = self.effect.canonical(), self.candidate.coordinates
        names = [c.parameter.name for c in coordinates]
        if effect == self.effect or names != [p.name for p in effect.about.parameters]:
            return self
        u = [c.coordinate(float(getattr(effect, name))) for c, name in zip(coordinates, names, strict=True)]
        return FittedEffect(self.candidate, np.array(u))

    @property
    def at_edge(self) -> tuple[str, ...]:
        """Numbers at the edge of their range: there the effect stands in for something that it is not.

        Sizes at the edge of their physical range, and shapes at that of the narrower one of this recording.
        """
        coordinates = self.candidate.coordinates
        names = []
        for i in (*self.candidate.sizes, *(i for i, c in enumerate(coordinates) if c.narrowed)):
            low, high = coordinates[i].bounds
            width = high - low  # of a narrowed shape; a size is near to its bound as a part of that
            near = (width, width) if coordinates[i].narrowed else (abs(low), abs(high))
            if not low + SEARCH.edge * near[0] + 1e-9 < self.u[i] < high - SEARCH.edge * near[1]:
                names.append(coordinates[i].parameter.name)
        return tuple(names)


def all_candidates(scene: Scene) -> list[Candidate]:
    """Return everything in the catalogue that could be missing in this machine, in a few shapes each.

    Effects on noise are left out: they change no mean, and are tested for by themselves.

    Parameters
    ----------
    scene : Scene
    """
    motor, body = scene.motor_path(), scene.machine.body
    scope = Scope(
        body.joints,
        body.types,
        np.stack([motor.min(axis=0), motor.max(axis=0)], axis=1),
        float(np.ptp(scene.motion.time)),
        kinematics=body.chain is not None,
        torques=scene.peak_torque(),
    )
    wanted = (s for s in shapes(scope) if s.kind.about.family != Family.NOISE)
    return [c for s in wanted for c in _of_shape(s, scene)]


def _of_shape(shape: Shape, scene: Scene) -> Iterator[Candidate]:
    """Candidates of a shape: one, or one for each session where the effect is of one session."""
    coordinates, start = _coordinates(shape, scene.n_sessions)
    place = dict(shape.place)
    joint = place.pop("joint")
    own_session = "session" in {f.name for f in fields(shape.kind)}
    instant = any(c.parameter.change_point for c in coordinates)
    for session in range(scene.n_sessions) if own_session else (None,):
        fixed = tuple(place.items()) + (() if session is None else (("session", session),))
        within = coordinates
        if instant:
            first, last = watched(scene, session or 0)
            if first >= last:
                continue
            within = tuple(replace(c, low=first, high=last) if c.parameter.change_point else c for c in coordinates)
        if not all(
            c.bounds[0] < c.bounds[1] and (c.bounds[0] <= u <= c.bounds[1] or not c.parameter.change_point)
            for u, c in zip(start, within, strict=True)
        ):  # the rest was clipped to its bounds
            continue
        candidate = Candidate(shape.kind, joint, fixed, within, start)
        try:
            candidate.build(np.array(start))
        except DataError:  # the shape is not possible
            continue
        yield candidate


def _coordinates(shape: Shape, n_sessions: int) -> tuple[tuple[Coordinate, ...], tuple[float, ...]]:
    """Coordinates of the parameters that are not left at their default, and where they start."""
    coordinates: list[Coordinate] = []
    start: list[float] = []
    grows = {p.name for p in shape.amplitudes}
    defaults = {f.name: f.default for f in fields(shape.kind)}
    for parameter in shape.kind.about.parameters:
        name, rung = parameter.name, shape.shape.get(parameter.name)
        if name not in grows if rung is None else rung == defaults[name] or np.isinf(rung):
            continue
        coordinate = coordinate_of(parameter, shape.joint_type, amplitude=rung is None)
        if name in shape.bounds:
            low, high = shape.bounds[name]
            low, high = max(coordinate.low, low), min(coordinate.high, high)
            coordinate = replace(coordinate, low=low, high=high, narrowed=True)
        at = coordinate.coordinate(coordinate.typical if rung is None else rung)
        count = n_sessions if parameter.per_session else 1
        coordinates += [coordinate] * count
        start += [float(np.clip(at, *coordinate.bounds))] * count
    return tuple(coordinates), tuple(start)


@dataclass(frozen=True)
class Estimate:
    """A parameter's value, 95 % interval and unit, SI; one of each a session where it has one a session.

    An int or a str is a field that is no number to estimate; the interval is None where nothing was estimated. For each
    value of a size, `nothing` is that of an effect of no size (zero, or an infinite stiffness) where the interval holds
    it; it is empty for a parameter that is no size.
    """

    value: float | int | str | tuple[float, ...]
    ci95: tuple[float, float] | tuple[tuple[float, float], ...] | None
    unit: str
    nothing: tuple[float | None, ...] = ()

    @property
    def is_clear(self) -> bool:
        """Whether it is a size, one of whose intervals keeps clear of an effect of no size."""
        return None in self.nothing


def describe(fit: FittedEffect, ends: Mapping[int, tuple[float, float]]) -> dict[str, Estimate]:
    """Return the estimates of an effect's parameters.

    Parameters
    ----------
    fit : FittedEffect, the effect with its numbers
    ends : mapping of int to pair of float, of the 95 % intervals of its coordinates
    """
    result: dict[str, Estimate] = {}
    candidate = fit.candidate
    for name, places in candidate.places.items():
        entries = []
        for i in places:
            c, (low, high) = candidate.coordinates[i], ends[i]
            first, last = sorted(c.value(float(np.clip(u, *c.bounds))) for u in (low, high))
            nothing = c.value(c.identity) if low <= c.identity <= high else None
            entries.append((c.value(float(fit.u[i])), (first, last), nothing))
        values, intervals, nothings = zip(*entries, strict=True)
        value, ci95 = (values, intervals) if len(places) > 1 else (values[0], intervals[0])
        unit, is_size = candidate.coordinates[places[0]].unit, places[0] in candidate.sizes
        result[name] = Estimate(value, ci95, unit, nothings if is_size else ())
    return result
