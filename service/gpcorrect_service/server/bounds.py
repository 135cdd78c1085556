"""The operator's bounds in time: how fast a streamed correction may change, and how many queries a second pass."""

from __future__ import annotations

import threading

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["RateBound", "Throttle"]

BURST_SECONDS = 0.1  # chosen by hand: of the rate that may come at once, for clients do not ask in step


class RateBound:
    """Bounds how fast a streamed correction changes, component by component; one object a stream.

    Parameters
    ----------
    limit : (k,) array
        Largest change a second.
    """

    def __init__(self, limit: FloatArray) -> None:
        self._limit = np.array(limit, dtype=np.float64)
        if not (self._limit > 0).all():
            raise DataError("rates are above zero.")
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next correction passes as it is."""
        self._last: tuple[float, FloatArray] | None = None

    def step(self, time: float, correction: FloatArray) -> tuple[FloatArray, bool]:
        """Return the correction as near to the wanted one as the rate allows, and whether it acted.

        Parameters
        ----------
        time : float
            s.
        correction : (k,) array
            What is wanted.
        """
        if not np.isfinite(correction).all():
            self.reset()
            return correction, False
        if self._last is None:
            self._last = time, correction
            return correction, False
        then, before = self._last
        most = self._limit * max(time - then, 0.0)
        bounded = before + np.clip(correction - before, -most, most)
        self._last = time, bounded
        return bounded, bool((np.abs(correction - bounded) > 1e-15).any())


class Throttle:
    """A token bucket: lets `rate` queries a second pass, a tenth of it at once; from any thread.

    Parameters
    ----------
    rate : float
        Queries a second; infinite for no limit.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._room = max(1.0, rate * BURST_SECONDS)
        self._tokens = self._room
        self._last = 0.0
        self._lock = threading.Lock()

    def passes(self, now: float) -> bool:
        """Whether a query may pass.

        Parameters
        ----------
        now : float
            When it comes, s, monotonic.
        """
        with self._lock:
            self._tokens = min(self._room, self._tokens + (now - self._last) * self._rate)
            self._last = now
            if self._tokens < 1.0:
                return False
            self._tokens -= 1.0
            return True
