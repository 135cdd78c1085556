"""What a hidden cause is: how its numbers are drawn, how it grows, and where it acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from truth.body import Body
from truth.hidden import Params
from truth.history import History, Readings
from truth.loop import Loop

Array = NDArray[np.float64]
REVOLUTE = (True, True, False)

Where = Literal["joint", "all", "tool", "base"]


@dataclass(frozen=True, eq=False)
class Scene:
    """What a draw may look at: the run without the effect.

    Parameters
    ----------
    history : History
        Motion of the machine without hidden effects.
    noise : (3,) array
        RMS of the noise on the outside joint sensors, rad or m.
    sessions : int
        How many.
    """

    history: History
    noise: Array
    sessions: int

    def load(self, j: int) -> Array:
        """Torque that the cable of column j carries, at logged ticks."""
        return self.history.motion.load[self.history.reference.logged, j]

    def path(self, j: int) -> Array:
        """Motor path of column j, at logged ticks."""
        return self.history.motion.motor[self.history.reference.logged, j]


Draw = Callable[[np.random.Generator, int, Scene], Params]


@dataclass(frozen=True)
class Kind:
    """One sort of hidden cause.

    Parameters
    ----------
    draw : callable
        `(rng, column, scene) -> params` of about the size of the noise.
    where : "joint", "all", "tool" or "base"
        What the label's `joint` says.
    grow, shrink : tuples of str
        Parameters that are multiplied, or divided, to make the effect larger.
    loop : callable or None
        `(params, column, loop, body) -> (loop, body)`: acts in the closed loop.
    path : callable or None
        `(params, column, history, q) -> error`: reported minus true joint path `(n, 3)`, given the path so far.
    tip : callable or None
        `(params, column, history, q, T) -> T`: acts on tool poses.
    read : callable or None
        `(params, column, history, readings) -> readings`.
    force : callable or None
        `(params, column, history) -> (n, 3)` torque from outside the machine.
    tracker_only, bare : bool
        Seen by the tracker alone; leaves its trace also where only joints are logged and nothing is known of loads.
    peaks : bool
        Acts only where the command is greatest, or the joint farthest out.
    power : mapping of str to float
        How a parameter is multiplied: by the factor to this power.
    channel : str
        Signal in which its size is measured.
    """

    draw: Draw
    where: Where = "joint"
    grow: tuple[str, ...] = ()
    shrink: tuple[str, ...] = ()
    loop: Callable[[Params, int, Loop, Body], tuple[Loop, Body]] | None = None
    path: Callable[[Params, int, History, Array], Array] | None = None
    tip: Callable[[Params, int, History, Array, Array], Array] | None = None
    read: Callable[[Params, int, History, Readings], Readings] | None = None
    force: Callable[[Params, int, History], Array] | None = None
    tracker_only: bool = False
    bare: bool = False
    peaks: bool = False
    channel: Literal["outside", "reported", "noise"] = "outside"
    power: Mapping[str, float] = field(default_factory=dict)


def unit(j: int, revolute: float, prismatic: float) -> float:
    """Return number for a turning or a sliding joint."""
    return revolute if REVOLUTE[j] else prismatic


def at(values: Array, j: int, value: float) -> Array:
    """Copy of `(3,)` values with one changed."""
    changed = np.array(values)
    changed[j] = value
    return changed


def column(n: int, j: int, values: Array) -> Array:
    """Zeros `(n, 3)` with one column."""
    out = np.zeros((n, 3))
    out[:, j] = values
    return out


def draw_sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(rng.choice([-1.0, 1.0]))
