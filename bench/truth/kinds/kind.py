"""What a hidden cause is: how its numbers are drawn, how it grows, and where it acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from truth.alike import rms
from truth.body import Body
from truth.hidden import Params
from truth.history import History, Readings
from truth.loop import Loop
from truth.reference import Reference

Array = NDArray[np.float64]
REVOLUTE = (True, True, False)
GAIN = (450.0, 360.0, 110000.0)  # typical kp, to turn an error into a torque


@dataclass(frozen=True, eq=False)
class Scene:
    """What a draw may look at: the run without the effect.

    Parameters
    ----------
    history : History, motion of the machine without hidden effects
    noise : (3,) array, RMS of the noise on the outside joint sensors, rad or m
    sessions : int, how many
    """

    history: History
    noise: Array
    sessions: int

    @property
    def reference(self) -> Reference:
        """What the arm was told to do."""
        return self.history.reference

    def unit(self, j: int, revolute: Any, prismatic: Any) -> Any:
        """Return what is for a turning or for a sliding joint."""
        return revolute if REVOLUTE[j] else prismatic

    def load(self, j: int) -> float:
        """RMS of the torque that the cable of column j carries, at least a little."""
        return max(rms(self._at(self.history.motion.load, j)), self.unit(j, 0.2, 0.5))

    def weight(self, j: int) -> float:
        """RMS of the part that holds the links up, at least a little."""
        return max(rms(self._at(self.history.motion.weight, j)), self.unit(j, 0.1, 0.3))

    def torque(self, j: int) -> float:
        """Torque that moves the motor by the noise, against its controller."""
        return float(GAIN[j] * self.noise[j])

    def stop_stiffness(self, j: int) -> float:
        """Stiffness of a stop before it is sized."""
        return float(self.unit(j, 3.0, 800.0))

    def command(self, j: int) -> Array:
        """Commanded torque at logged ticks."""
        return self._at(self.history.motion.command, j)

    def moving(self, j: int) -> Array:
        """Whether the joint moves at each tick."""
        return np.abs(self.history.motion.speed[:, j]) > 0

    def other(self, rng: np.random.Generator, j: int) -> int:
        """Return the column of another joint."""
        return int(rng.choice([k for k in range(3) if k != j]))

    def path(self, j: int) -> Array:
        """Motor path of column j, at logged ticks."""
        return self._at(self.history.motion.motor, j)

    def _at(self, signal: Array, j: int) -> Array:
        return signal[self.reference.logged, j]


Draw = Callable[[np.random.Generator, int, Any], Params]


@dataclass(frozen=True)
class Cause:
    """One sort of hidden cause, of either truth; a run is what the truth's simulator recorded.

    Parameters
    ----------
    draw : callable, `(rng, column, scene) -> params` of about the size of the noise
    where : "joint", "all", "tool" or "base", what the label's `joint` says
    grow, shrink : tuples of str, parameters that are multiplied, or divided, to make the effect larger
    power : mapping of str to float, how a parameter is multiplied: by the factor to this power
    path : callable or None
        `(params, column, run, q) -> error`: reported minus true joint path `(n, k)`, given the path so far.
    tip : callable or None
        `(params, column, run, T) -> T`: acts on tool poses; of the NumPy truth, q comes before T.
    read : callable or None, `(params, column, run, readings) -> readings`
    tracker_only, bare : bool
        Seen by the tracker alone; leaves its trace also where only joints are logged and nothing is known of loads.
    peaks : bool, acts only where the command is greatest, or the joint farthest out
    channel : str, signal in which its size is measured
    """

    draw: Draw
    where: Literal["joint", "all", "tool", "base"] = "joint"
    grow: tuple[str, ...] = ()
    shrink: tuple[str, ...] = ()
    power: Mapping[str, float] = field(default_factory=dict)
    path: Callable[..., Array] | None = None
    tip: Callable[..., Array] | None = None
    read: Callable[..., Readings] | None = None
    tracker_only: bool = False
    bare: bool = False
    peaks: bool = False
    channel: Literal["outside", "reported", "noise"] = "outside"


@dataclass(frozen=True)
class Kind(Cause):
    """One that may also act in the closed loop.

    Parameters
    ----------
    loop : callable or None, `(params, column, loop, body) -> (loop, body)`
    force : callable or None, `(params, column, history) -> (n, 3)` torque from outside the machine
    """

    loop: Callable[[Params, int, Loop, Body], tuple[Loop, Body]] | None = None
    force: Callable[[Params, int, History], Array] | None = None


def at(values: Array, j: int, value: float) -> Array:
    """Copy of values with one changed."""
    changed = np.array(values)
    changed[j] = value
    return changed


def column(n: int, j: int, values: Array) -> Array:
    """Zeros `(n, 3)` with one column."""
    out = np.zeros((n, 3))
    out[:, j] = values
    return out
