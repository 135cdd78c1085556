"""How many queries a second a key takes: a token bucket."""

from __future__ import annotations

import threading

__all__ = ["Throttle"]

BURST_SECONDS = 0.1  # of the rate that may come at once: clients do not ask in step


class Throttle:
    """Lets `rate` queries a second pass, a tenth of it at once; from any thread.

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
        """Whether a query that comes at `now` (s, monotonic) may pass."""
        with self._lock:
            self._tokens = min(self._room, self._tokens + (now - self._last) * self._rate)
            self._last = now
            if self._tokens < 1.0:
                return False
            self._tokens -= 1.0
            return True
