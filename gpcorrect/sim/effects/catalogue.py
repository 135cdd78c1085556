"""The catalogue: effects by name, and each of them wherever it may sit, in a few shapes, for searches.

It fills itself: a new effect is a class in a file here, and nothing else.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from itertools import product
from typing import Any, TypeVar

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import ChainEffect, Effect, LoadEffect, TipEffect
from gpcorrect.sim.effects.description import Parameter, Per, Site
from gpcorrect.types import FloatArray

E = TypeVar("E", bound=Effect)

BESIDE = 0.05  # of a ladder's count, beside a default on which a rung falls: its signature is nearly the same there


def find_effects() -> Mapping[str, type[Effect]]:
    """Return the effects that the files of this package define, by name, in the order of their catalogue numbers."""
    found: list[type[Effect]] = []
    for file in pkgutil.iter_modules(sys.modules[__package__].__path__, f"{__package__}."):
        module = importlib.import_module(file.name)
        kinds = [kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == file.name]
        found += [kind for kind in kinds if issubclass(kind, Effect) and hasattr(kind, "about")]
    return {kind.about.name: kind for kind in sorted(found, key=lambda kind: (kind.about.number, kind.about.name))}


EFFECTS = find_effects()


def effect_from_dict(values: Mapping[str, Any]) -> Effect:
    """Return the effect that `Effect.to_dict` wrote down.

    Parameters
    ----------
    values : mapping, `name`, `joint` and the effect's own fields

    Raises
    ------
    DataError
        No effect has the name, a parameter is missing or no number, or the effect does not know a key.
    """
    name = values.get("name")
    if not isinstance(name, str) or name not in EFFECTS:
        raise DataError(f"no effect is called {name!r}.", hint=f"Known effects: {', '.join(EFFECTS)}.")
    kind = EFFECTS[name]
    given = {key: value for key, value in values.items() if key != "name"}
    keys = {f.name: f.default is MISSING for f in fields(kind)}
    hint = f"It has: {', '.join(keys)}."
    if unknown := sorted(set(given) - set(keys)):
        raise DataError(f"effect {name} knows no key {', '.join(unknown)}.", hint=hint)
    if missing := [key for key, needed in keys.items() if needed and key not in given]:
        raise DataError(f"effect {name} lacks {', '.join(missing)}.", hint=hint)
    return kind(**given)


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Return effects in the order in which they act: stage, then catalogue number, then joint; ties as they come.

    Parameters
    ----------
    effects : iterable of Effect
    """
    return tuple(sorted(effects, key=lambda e: (e.stage, e.about.number, str(e.joint))))


def of_kind(effects: Iterable[Effect], kind: Callable[..., E]) -> tuple[E, ...]:
    """Return the effects of one interface, such as :class:`~gpcorrect.sim.effects.PathEffect`, in their order.

    Parameters
    ----------
    effects : iterable of Effect
    kind : type of Effect, typed as a callable because mypy takes no abstract class for a `type[E]`
    """
    assert isinstance(kind, type)
    found: list[Any] = [e for e in effects if isinstance(e, kind)]
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Scope:
    """The machine and the recording in which something may be missing.

    Parameters
    ----------
    joints : tuple of int, joint numbers
    types : str, "R" or "P" for each
    ranges : (dof, 2) array, lowest and highest value that each joint takes, rad or m
    session_seconds : float, duration of a session
    kinematics : bool, whether there is an arm, or bare joints only
    torques : (dof,) array, optional
        Largest torque that each joint's controller asks for, N m or N; the prior's where it is not known.
    """

    joints: tuple[int, ...]
    types: str
    ranges: FloatArray
    session_seconds: float
    kinematics: bool = True
    torques: FloatArray | None = None

    @property
    def is_loaded(self) -> bool:
        """Whether controllers are known to carry the links."""
        return self.kinematics and self.torques is not None

    def _type_of(self, joint: int | str) -> str:
        """Return "R" or "P"; what belongs to no joint counts in metres."""
        return self.types[self.joints.index(joint)] if isinstance(joint, int) else "P"

    def _range_of(self, joint: int | str) -> FloatArray:
        return self.ranges[self.joints.index(joint)] if isinstance(joint, int) else np.array([0.0, 1.0])


@dataclass(frozen=True)
class Candidate:
    """An effect in a place and a shape, its amplitudes still open.

    Parameters
    ----------
    kind : type of Effect
    place : mapping, fields that say where: `joint`, and `source`, `side` or `end` where it has them
    shape : mapping, values of the parameters that have a ladder
    amplitudes : tuple of Parameter
        Parameters with which its trace grows (or with whose inverse, where the identity is infinite); none where the
        shape says all.
    joint_type : str, "R" or "P": which of a parameter's ranges holds
    bounds : mapping, of the parameters that this recording bounds more narrowly than their physical range
    """

    kind: type[Effect]
    place: Mapping[str, Any]
    shape: Mapping[str, float]
    amplitudes: tuple[Parameter, ...]
    joint_type: str
    bounds: Mapping[str, tuple[float, float]]

    def effect(self, **amplitudes: float) -> Effect:
        """Return the effect with these amplitudes, the others at what does nothing.

        Raises
        ------
        DataError
            A value has no meaning.
        """
        neutral: dict[str, Any] = {p.name: p.identity for p in self.amplitudes}
        return self.kind(**{**self.place, **self.shape, **neutral, **amplitudes})

    def typical(self) -> Effect:
        """Return the effect with amplitudes of the prior's typical size."""
        return self.effect(**{p.name: p.range(self.joint_type).typical for p in self.amplitudes})


def candidates(scope: Scope) -> Iterator[Candidate]:
    """Yield everything that the catalogue could name in a machine, from the descriptions alone.

    Parameters
    ----------
    scope : Scope
    """
    for kind in EFFECTS.values():
        if not scope.kinematics and issubclass(kind, ChainEffect | LoadEffect | TipEffect):
            continue
        fields_of_choice = [[(field, value) for value in values] for field, values in kind.about.choices]
        for site in kind.about.sites:
            for place, choice in product(_of_site(site, scope), product(*fields_of_choice)):
                if kind.about.loaded in choice and not scope.is_loaded:
                    continue
                yield from _shapes(kind, place | dict(choice), scope)


def _of_site(site: Site, scope: Scope) -> list[dict[str, Any]]:
    pairs = product(scope.joints, zip(scope.joints, scope.types, strict=True))
    match site:
        case Site.JOINT:
            return [{"joint": j} for j in scope.joints]
        case Site.PAIR:
            return [{"joint": j, "source": k} for j, (k, _) in pairs if k != j]
        case Site.INSERTION:
            return [{"joint": j, "source": k} for j, (k, joint_type) in pairs if joint_type == "P"]
        case _:
            return [{"joint": str(site)}]


def _shapes(kind: type[Effect], place: dict[str, Any], scope: Scope) -> Iterator[Candidate]:
    """Candidates at every combination of the ladders' rungs; amplitudes that a shape makes void are left out."""
    there = [p for p in kind.about.parameters if p.only is None or place[p.only[0]] in p.only[1:]]
    shaped = [p for p in there if p.ladder is not None]
    absent = {f.name: f.default for f in fields(kind) if f.default is not MISSING}
    for values in product(*(dict.fromkeys(_rungs(p, place, scope, absent.get(p.name))) for p in shaped)):
        shape = dict(zip((p.name for p in shaped), values, strict=True))
        void = {name for name, value in shape.items() if value == absent.get(name)}
        if sum(p.ladder is not None and p.ladder.absent and p.name not in void for p in shaped) > 1:
            continue
        amplitudes = tuple(p for p in there if p.ladder is None and p.shaped_by not in void)
        bounds = {p.name: b for p in shaped if (b := _bounds(p, place, scope)) is not None}
        yield Candidate(kind, place, shape, amplitudes, scope._type_of(place["joint"]), bounds)


def _bounds(parameter: Parameter, place: Mapping[str, Any], scope: Scope) -> tuple[float, float] | None:
    assert parameter.ladder is not None
    if parameter.ladder.within is None:
        return None
    start, scale = _count(parameter, place, scope)
    low, high = sorted(start + scale * end for end in parameter.ladder.within)
    return low, high


def _rungs(parameter: Parameter, place: Mapping[str, Any], scope: Scope, default: float | None) -> list[float]:
    assert parameter.ladder is not None
    start, scale = _count(parameter, place, scope)
    rungs = [float(start + scale * rung) for rung in parameter.ladder.rungs]
    if not parameter.ladder.absent or default is None:
        return rungs
    # The middle of a motion about zero is where a home is by default, and is not the same as having none to seek.
    return [default, *(rung if rung != default else float(rung + BESIDE * scale) for rung in rungs)]


def _count(parameter: Parameter, place: Mapping[str, Any], scope: Scope) -> tuple[float, float]:
    """Where a ladder's count is zero, and one of it, in the parameter's unit."""
    assert parameter.ladder is not None
    joint = place["joint"]
    low, high = map(float, scope._range_of(place.get("source", joint)))
    match parameter.ladder.per:
        case Per.VALUE:
            return 0.0, 1.0
        case Per.PRIOR:
            return 0.0, parameter.range(scope._type_of(joint)).typical
        case Per.RANGE:
            return 0.0, high - low
        case Per.PLACE:
            return low, high - low
        case Per.END:
            return (high, low - high) if place["end"] == "upper" else (low, high - low)
        case Per.SWEEP:
            return 0.0, 1.0 / max(high - low, 1e-9)
        case Per.SESSION:
            return 0.0, scope.session_seconds
        case Per.TORQUE:
            typical = parameter.range(scope._type_of(joint)).typical
            return 0.0, typical if scope.torques is None else float(scope.torques[scope.joints.index(joint)])
