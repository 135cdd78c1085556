"""What replays of one recording have in common: values computed once, those not asked for longest forgotten."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

from gpcorrect.sim.effect_paths import Column
from gpcorrect.sim.plant import Command, Driven
from gpcorrect.types import FloatArray

LOOP_BYTES = 1_000_000_000  # of closed-loop runs: memory only, no result depends on it
COLUMN_BYTES = 200_000_000  # of joints' paths behind some effects: as for loops
BEGUN = 4  # commands that begin with the runs of others
Value = TypeVar("Value")


class Remembered(Generic[Value]):
    """What was asked for last, by key, for several threads: the others are forgotten, and no result depends on it.

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
        with self._lock:
            if key in self._known:
                self._known[key] = self._known.pop(key)  # the last to be forgotten
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

    command: Command | None = None  # of the closed loop
    begun: Remembered[Command] = field(default_factory=partial(Remembered, BEGUN))  # the same from others' runs
    loops: Remembered[Driven] = field(default_factory=partial(Remembered, LOOP_BYTES))
    columns: Remembered[Column] = field(default_factory=partial(Remembered, COLUMN_BYTES))  # where no loop is run
    pull: FloatArray | None = None  # of each joint's load at rest for each joint's position

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes an empty one, as of all that is remembered."""
        return type(self), ()
