"""What was computed last, by key, for several threads: the oldest are forgotten, and no result depends on it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

from gpcorrect.types import FloatArray

V = TypeVar("V")


def one(_: Any) -> int:
    """Return what a value costs where they are counted."""
    return 1


def in_bytes(values: FloatArray) -> int:
    """Return what an array costs.

    Parameters
    ----------
    values : array
    """
    return values.nbytes


class Remembered(Generic[V]):
    """A bounded store of values.

    Parameters
    ----------
    most : int, cost that all values together may have
    cost : callable, of a value
    """

    def __init__(self, most: int, cost: Callable[[V], int] = one) -> None:
        self._most, self._cost = most, cost
        self._known: dict[Hashable, V] = {}
        self._lock = threading.Lock()
        self._spent = 0

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes an empty one: copies and other processes begin with nothing."""
        return type(self), (self._most, self._cost)

    def get(self, key: Hashable) -> V | None:
        """Return what is remembered.

        Parameters
        ----------
        key : hashable
        """
        return self._known.get(key)

    def keep(self, key: Hashable, value: V) -> V:
        """Remember a value, and return it; the newest stays whatever it costs.

        Parameters
        ----------
        key : hashable
        value
        """
        with self._lock:
            if key not in self._known:
                self._known[key] = value
                self._spent += self._cost(value)
            while self._spent > self._most and len(self._known) > 1:
                self._spent -= self._cost(self._known.pop(next(iter(self._known))))
        return value
