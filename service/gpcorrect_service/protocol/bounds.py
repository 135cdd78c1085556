"""The operator's bounds: how large a correction, how fast it changes, how many queries pass, how old they may be."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

POSE = 7  # numbers of a pose: position and quaternion
BURST_SECONDS = 0.1  # chosen by hand: of the rate that may come at once, for clients do not ask in step
OLDEST = 0.25
"""s: nothing older moves a robot. Chosen by hand: a person reacts in 0.2 s, and a tool at 5 cm/s goes 12 mm."""
DRIFT = 1e-3  # of a clock against ours: ten times what cheap quartz does, so that a backlog is not believed soon
JITTER = 0.02  # chosen by hand: s by which messages overtake each other; clocks are stepped by 0.1 and more
SETTLED = 1.0  # chosen by hand: s for which stamps that went back must go on so, before the clock is taken to be set


@dataclass(frozen=True)
class CorrectionBound:
    """The largest learned correction that may leave a server: command against the registration's reference pose."""

    position: float = np.inf  # m; infinite for none
    rotation: float = np.inf  # rad; infinite for none

    def __post_init__(self) -> None:
        if not (self.position > 0 and self.rotation > 0):
            raise DataError(f"bounds of a correction are above zero, got {self.position} m and {self.rotation} rad.")

    @property
    def acts(self) -> bool:
        """Whether anything is bounded at all."""
        return bool(np.isfinite(self.position) or np.isfinite(self.rotation))

    def apply(self, reference: FloatArray, command: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Shorten the way from reference to command, straight and in one turn; tell which (n,) were cut.

        Parameters
        ----------
        reference, command : (n, 7) or (n, 3) arrays
        """
        shift, short = _shortened(command[:, :3] - reference[:, :3], self.position)
        position = np.where(short[:, None], reference[:, :3] + shift, command[:, :3])
        bounded = np.hstack([position, command[:, 3:]])
        if command.shape[1] == POSE:
            R_reference = se3.matrix_from_quaternion(reference[:, 3:])
            R_turn = se3.matrix_from_quaternion(command[:, 3:]) @ R_reference.transpose(0, 2, 1)
            turn, short_turn = _shortened(se3.rotvec_from_matrix(R_turn), self.rotation)
            within = se3.quaternion_from_matrix(se3.matrix_from_rotvec(turn) @ R_reference)
            bounded[:, 3:] = np.where(short_turn[:, None], within, command[:, 3:])
            short = short | short_turn
        return bounded, short


def _shortened(vectors: FloatArray, bound: float) -> tuple[FloatArray, BoolArray]:
    size = np.linalg.norm(vectors, axis=1)
    scale = np.minimum(1.0, bound / np.maximum(size, 1e-300))
    return vectors * scale[:, None], scale < 1.0


class RateBound:
    """Bounds how fast a streamed correction changes, by a limit a second for every component; one a stream.

    A component that is missing in a sample begins anew, and no other does.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next correction passes as it is."""
        self._last: tuple[float, FloatArray] | None = None

    def step(self, time: float, correction: FloatArray) -> tuple[FloatArray, bool]:
        """Return the correction (k,) as near to the wanted one as the rate allows, and whether it acted.

        Parameters
        ----------
        time : float, s
        correction : (k,) array, NaN where missing
        """
        bounded = correction
        if self._last is not None:
            then, before = self._last
            most = self._limit * max(time - then, 0.0)
            bounded = np.where(np.isnan(before), correction, before + np.clip(correction - before, -most, most))
        self._last = time, bounded
        return bounded, bool((np.abs(correction - bounded) > 1e-15).any())


class Throttle:
    """A token bucket: lets `rate` queries a second pass (infinite for all), a tenth of it at once; from any thread."""

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
        now : float, when it comes, s, monotonic
        """
        with self._lock:
            self._tokens = min(self._room, self._tokens + (now - self._last) * self._rate)
            self._last = now
            if self._tokens < 1.0:
                return False
            self._tokens -= 1.0
            return True


class StreamClock:
    """Another machine's clock, as the stamps and arrivals of its messages show it.

    The message that was quickest on its way says how far the two clocks are apart; what took longer was held up: in a
    process that was stopped, a router, a network. Where the two clocks were set to plays no part. What was held up
    comes in order: stamps that go back, and stay behind by the same for a second, are of a clock that was set back.

    Parameters
    ----------
    rate : float, seconds of that clock in one of ours: above 1 for a simulated arm that lives faster
    """

    def __init__(self, rate: float = 1.0) -> None:
        self._rate = rate
        self.reset()

    def reset(self) -> None:
        """Forget the clock: the next message is taken to be quick."""
        self._apart: float | None = None
        self._stamp, self._at = 0.0, 0.0
        self._back: tuple[float, float] | None = None  # how far the clocks are apart since stamps went back, and when

    def delay(self, stamp: float, now: float) -> float:
        """Take note of a message; return how much longer it was on its way than the quickest one, s.

        Parameters
        ----------
        stamp, now : float, s of its clock; s of ours, when it came
        """
        apart = now - stamp / self._rate
        self._apart = apart if self._apart is None else min(apart, self._known(stamp, now))
        self._stamp, self._at = stamp, now
        return apart - self._apart

    def age(self, stamp: float, now: float) -> float:
        """Return how long ago that clock showed a stamp, s of ours; below 0 where it does not yet show it.

        Parameters
        ----------
        stamp, now : float, as for :meth:`delay`
        """
        return 0.0 if self._apart is None else now - stamp / self._rate - self._apart

    def _known(self, stamp: float, now: float) -> float:
        """Return how far the clocks are apart, as messages before this one say and stamps that went back."""
        assert self._apart is not None
        known, apart = self._apart + DRIFT * (now - self._at), now - stamp / self._rate
        if self._back is None and stamp >= self._stamp - JITTER * self._rate:
            return known
        if apart <= self._apart + JITTER:  # one came late, and those of the clock as it was go on
            self._back = None
            return known
        if self._back is None or apart < self._back[0] - JITTER:
            self._back = apart, now
        if now - self._back[1] > SETTLED:
            known, self._back = self._back[0], None
        return known
