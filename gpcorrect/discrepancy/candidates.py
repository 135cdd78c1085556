"""Every effect of the catalogue on every joint it could act on: what may be missing. Nothing here knows an effect by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any

import numpy as np

from gpcorrect.discrepancy.coordinates import Coordinate, coordinate_of
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import EFFECTS, Effect, Stage
from gpcorrect.types import FloatArray

__all__ = ["Candidate", "Member", "all_candidates"]

WHOLE = {Stage.LOAD: "all", Stage.CLOCK: "all", Stage.TIP: "tool", Stage.BASE: "base"}
SHAPES = (1.0, 0.25, 4.0)  # of the typical value: where a shape parameter is tried


@dataclass(frozen=True)
class Candidate:
    """An effect on a joint, with its numbers still open.

    Parameters
    ----------
    kind : type of Effect
        From the registry.
    joint : int or str
        Where it would act.
    fixed : tuple of (field, value)
        Fields that are no numbers to estimate, such as a coupling's source.
    coordinates : tuple of Coordinate
        Numbers to estimate, one for each session where the effect has one a session.
    counts : tuple of int
        How many coordinates each parameter has, in the order of its description; 0 for those left at their default.
    start : tuple of float
        Coordinates at which its signature is taken.
    """

    kind: type[Effect]
    joint: int | str
    fixed: tuple[tuple[str, Any], ...]
    coordinates: tuple[Coordinate, ...]
    counts: tuple[int, ...]
    start: tuple[float, ...]

    @property
    def name(self) -> str:
        """Canonical name of the effect."""
        return self.kind.about.name

    @property
    def family(self) -> str:
        """Its class in the catalogue."""
        return str(self.kind.about.family)

    @property
    def key(self) -> tuple[Any, ...]:
        """What it is, whatever its numbers: two members of a set with one key are one."""
        return (self.name, self.joint, self.fixed)

    @property
    def label(self) -> str:
        """Words for tables and figures."""
        extra = "".join(f", {k} {v}" for k, v in self.fixed)
        return f"{self.name.replace('_', ' ')} ({self.joint}{extra})"

    @property
    def amplitudes(self) -> tuple[int, ...]:
        """Indices of the coordinates that the effect grows with."""
        return tuple(i for i, c in enumerate(self.coordinates) if c.amplitude)

    def build(self, u: FloatArray) -> Effect:
        """Return the effect at these coordinates."""
        values: dict[str, Any] = {}
        position = 0
        for parameter, count in zip(self.kind.about.parameters, self.counts, strict=True):
            if count == 0:
                continue
            numbers = [self.coordinates[i].value(float(u[i])) for i in range(position, position + count)]
            values[parameter.name] = tuple(numbers) if count > 1 else numbers[0]
            position += count
        return self.kind(joint=self.joint, **dict(self.fixed), **values)

    def scaled(self, factors: FloatArray) -> FloatArray:
        """Coordinates with the amplitudes moved to `factors` times their start, inside the bounds."""
        u = np.array(self.start)
        for i, factor in zip(self.amplitudes, factors, strict=True):
            base = self.coordinates[i].identity
            u[i] = base + factor * (u[i] - base)
        low, high = np.array([c.bounds for c in self.coordinates]).T
        clipped: FloatArray = np.clip(u, low, high)
        return clipped


@dataclass(frozen=True, eq=False)
class Member:
    """A candidate with its numbers."""

    candidate: Candidate
    u: FloatArray

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.candidate.build(self.u)


def all_candidates(joints: tuple[int, ...], types: str, n_sessions: int) -> list[Candidate]:
    """Everything in the catalogue that could be missing in a machine with these joints."""
    found: list[Candidate] = []
    for kind in EFFECTS.values():
        for joint in _places(kind, joints):
            joint_type = types[joints.index(joint)] if isinstance(joint, int) else "R"
            for fixed in _fixed_choices(kind, joint, joints):
                found += _variants(kind, joint, joint_type, fixed, n_sessions)
    return found


def _places(kind: type[Effect], joints: tuple[int, ...]) -> tuple[int | str, ...]:
    declared = getattr(kind, "places", None)
    if declared is not None:
        return tuple(joints) if "joint" in declared else tuple(declared)
    return (WHOLE[kind.stage],) if kind.stage in WHOLE else joints


def _fixed_choices(
    kind: type[Effect], joint: int | str, joints: tuple[int, ...]
) -> list[tuple[tuple[str, Any], ...]]:
    """Choices for the required fields that are no parameters: the only ones known are numbers of other joints."""
    numbers = {p.name for p in kind.about.parameters}
    required = [f for f in fields(kind) if f.name != "joint" and f.name not in numbers and _is_required(f)]
    if not required:
        return [()]
    if len(required) > 1 or "int" not in str(required[0].type):
        return []
    return [((required[0].name, other),) for other in joints if other != joint]


def _is_required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _variants(
    kind: type[Effect], joint: int | str, joint_type: str, fixed: tuple[tuple[str, Any], ...], n_sessions: int
) -> list[Candidate]:
    """Candidates with the required numbers open, at several values of the shape parameters; then with the optional ones open too."""
    own = {f.name: f for f in fields(kind)}
    required = tuple(_is_required(own[p.name]) for p in kind.about.parameters)
    choices = [required] if all(required) else [required, tuple(True for _ in required)]
    found = []
    for free in choices:
        coordinates, counts = _coordinates(kind, joint_type, free, n_sessions)
        for start in _starts(coordinates):
            candidate = Candidate(kind, joint, fixed, coordinates, counts, start)
            if _is_possible(candidate):
                found.append(candidate)
    return found


def _coordinates(
    kind: type[Effect], joint_type: str, free: tuple[bool, ...], n_sessions: int
) -> tuple[tuple[Coordinate, ...], tuple[int, ...]]:
    coordinates: list[Coordinate] = []
    counts = []
    for i, (parameter, is_free) in enumerate(zip(kind.about.parameters, free, strict=True)):
        count = (n_sessions if parameter.per_session else 1) if is_free else 0
        coordinates += [coordinate_of(parameter, joint_type, amplitude=i == 0)] * count
        counts.append(count)
    return tuple(coordinates), tuple(counts)


def _starts(coordinates: tuple[Coordinate, ...]) -> list[tuple[float, ...]]:
    """Typical values, and the shape parameters together at other ones."""
    starts: dict[tuple[float, ...], None] = {}
    for shape in SHAPES:
        u = [_start_of(c, shape) for c in coordinates]
        low, high = np.array([c.bounds for c in coordinates]).T
        starts[tuple(np.clip(u, low, high).tolist())] = None
    return list(starts)


def _start_of(coordinate: Coordinate, shape: float) -> float:
    if coordinate.kind == "log":
        return float(np.log(shape))
    # A one-sided amplitude shapes its own signature (the width of a play), a two-sided one only scales it.
    return shape if coordinate.amplitude and coordinate.parameter.positive else 1.0


def _is_possible(candidate: Candidate) -> bool:
    try:
        candidate.build(np.array(candidate.start))
    except DataError:
        return False
    return True


def describe(member: Member, half_widths: Mapping[int, float]) -> dict[str, dict[str, Any]]:
    """Parameters with value, 95 % interval and unit; `half_widths` of the coordinates."""
    result: dict[str, dict[str, Any]] = {}
    position = 0
    candidate = member.candidate
    for parameter, count in zip(candidate.kind.about.parameters, candidate.counts, strict=True):
        entries = []
        for i in range(position, position + count):
            c, u, half = candidate.coordinates[i], float(member.u[i]), half_widths.get(i, np.inf)
            low, high = c.bounds
            ends = sorted((c.value(float(np.clip(u - half, low, high))), c.value(float(np.clip(u + half, low, high)))))
            entries.append((c.value(u), ends, c.unit))
        position += count
        if count == 1:
            result[parameter.name] = {"value": entries[0][0], "ci95": entries[0][1], "unit": entries[0][2]}
        elif count > 1:
            values, ends_of, units = zip(*entries, strict=True)
            result[parameter.name] = {"value": list(values), "ci95": list(ends_of), "unit": units[0]}
    return result
