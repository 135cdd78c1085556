"""The effects by name. The registry fills itself: a new effect is a class in a file here, and nothing else."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from gpcorrect.errors import DataError
from gpcorrect.sim import effects as package
from gpcorrect.sim.effects.base import Effect

E = TypeVar("E", bound=Effect)


def find_effects() -> Mapping[str, type[Effect]]:
    """Return the effects that the files of this package define, by name, in the order of their catalogue numbers."""
    found: list[type[Effect]] = []
    for file in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        module = importlib.import_module(file.name)
        kinds = [kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == file.name]
        found += [kind for kind in kinds if issubclass(kind, Effect) and hasattr(kind, "about")]
    return {kind.about.name: kind for kind in sorted(found, key=lambda kind: (kind.about.number, kind.about.name))}


EFFECTS = find_effects()


def effect_from_dict(values: Mapping[str, Any]) -> Effect:
    """Return the effect that `Effect.to_dict` wrote down.

    Parameters
    ----------
    values : mapping
        `name`, `joint` and the effect's own fields.

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
    kind : type of Effect
        Typed as a callable because mypy takes no abstract class for a `type[E]`.
    """
    assert isinstance(kind, type)
    found: list[Any] = [e for e in effects if isinstance(e, kind)]
    return tuple(found)
