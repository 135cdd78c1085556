"""What replays of one recording have in common: values computed once, the oldest of them forgotten for the newest."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

from gpcorrect.sim.plant import Command, Driven
from gpcorrect.types import FloatArray

# Of closed-loop runs, of them at the plan's samples, and of loads: memory only, no result depends on it.
LOOP_BYTES, RECENT_BYTES, LOAD_BYTES = 1_000_000_000, 200_000_000, 120_000_000
BEGUN = 4  # commands that begin with the runs of others
Value = TypeVar("Value")


class Remembered(Generic[Value]):
    """What was computed last, by key, for several threads: the oldest are forgotten, and no result depends on it.

    All values together cost no more than `most`: an array its bytes, anything else one.
    """

    def __init__(self, most: int) -> None:
        self._most, self._spent, self._lock = most, 0, threading.Lock()
        self._known: dict[Hashable, Value] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes an empty one: copies and other processes begin with nothing."""
        return type(self), (self._most,)

    def get(self, key: Hashable) -> Value | None:
        """Return what is remembered.

        Parameters
        ----------
        key : hashable
        """
        return self._known.get(key)

    def keep(self, key: Hashable, value: Value) -> Value:
        """Remember a value, and return it; the newest stays whatever it costs.

        Parameters
        ----------
        key : hashable
        value
        """
        with self._lock:
            if key not in self._known:
                self._known[key] = value
                self._spent += getattr(value, "nbytes", 1)
            while self._spent > self._most and len(self._known) > 1:
                self._spent -= getattr(self._known.pop(next(iter(self._known))), "nbytes", 1)
        return value


@dataclass(eq=False)
class ReplayMemory:
    """What was simulated so far, by the effects that it was simulated with."""

    commands: dict[Hashable, Command] = field(default_factory=dict)  # by the runs that they are of
    begun: Remembered[Command] = field(default_factory=partial(Remembered, BEGUN))  # the same from others' runs
    recent: Remembered[Driven] = field(default_factory=partial(Remembered, RECENT_BYTES))
    own: Driven | None = None  # the closed loop with the model's own effects alone
    loops: Remembered[Driven] = field(default_factory=partial(Remembered, LOOP_BYTES))
    more_loads: Remembered[FloatArray] = field(default_factory=partial(Remembered, LOAD_BYTES))
    pull: FloatArray | None = None  # of each joint's load at rest for each joint's position

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes an empty one, as of all that is remembered."""
        return type(self), ()
