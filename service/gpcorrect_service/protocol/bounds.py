"""The operator's bounds: how large a correction may be, how fast a streamed one may change, how many queries pass."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

POSE = 7  # numbers of a pose: position and quaternion
BURST_SECONDS = 0.1  # chosen by hand: of the rate that may come at once, for clients do not ask in step


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
    """Bounds how fast a streamed correction changes, by a limit (k,) a second, of each component; one a stream."""

    def __init__(self, limit: FloatArray) -> None:
        self._limit = np.array(limit, dtype=np.float64)
        if not (self._limit > 0).all():
            raise DataError("rates are above zero.")
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next correction passes as it is."""
        self._last: tuple[float, FloatArray] | None = None

    def step(self, time: float, correction: FloatArray) -> tuple[FloatArray, bool]:
        """Return the correction (k,) as near to the wanted one as the rate allows, and whether it acted.

        Parameters
        ----------
        time : float, s
        correction : (k,) array
        """
        if not np.isfinite(correction).all():
            self.reset()
            return correction, False
        bounded = correction
        if self._last is not None:
            then, before = self._last
            most = self._limit * max(time - then, 0.0)
            bounded = before + np.clip(correction - before, -most, most)
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
