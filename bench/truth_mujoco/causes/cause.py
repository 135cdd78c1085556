"""What a hidden cause is: how its numbers are drawn, how it grows, and where it acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from truth.hidden import Params
from truth.history import Readings

from truth_mujoco.arms import Arm
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene:
    """What a draw may look at: the run without the cause, and RMS `(k,)` of the noise as seen at the joints."""

    run: Run
    noise: Array
    sessions: int

    @property
    def arm(self) -> Arm:
        """Return the arm."""
        return self.run.plant.arm

    def load(self, j: int) -> float:
        """RMS of the torque that the links ask of a joint, at least a little."""
        return max(rms(self.run.load[self.run.reference.logged, j]), self.arm.unit(j, 0.2, 0.5))

    def weight(self, j: int) -> float:
        """RMS of the part that holds the links up, at least a little."""
        return max(rms(self.run.weight[self.run.reference.logged, j]), self.arm.unit(j, 0.1, 0.3))

    def path(self, j: int) -> Array:
        """Motor path at logged ticks."""
        return self.run.recorded.reported[self.run.reference.logged, j]

    def torque(self, j: int) -> float:
        """Torque that moves the motor by the noise, against its controller."""
        return float(self.run.plant.kp[j] * self.noise[j])

    def other(self, rng: np.random.Generator, j: int) -> int:
        """Return the column of another joint; beside it where there are many."""
        near = [k for k in range(self.arm.dof) if k != j and (self.arm.dof < 4 or abs(k - j) < 3)]
        return int(rng.choice(near))


Draw = Callable[[np.random.Generator, int, Scene], Params]


@dataclass(frozen=True)
class Cause:
    """One sort of hidden cause.

    Parameters
    ----------
    draw : callable
        `(rng, column, scene) -> params` of about the size of the noise.
    where : "joint", "all", "tool" or "base"
        What the label's `joint` says.
    grow, shrink : tuples of str
        Parameters that are multiplied, or divided, to make the effect larger.
    power : mapping of str to float
        How a parameter is multiplied: by the factor to this power.
    build : callable or None
        `(params, column, plant) -> plant`: acts in MuJoCo's model or its controller.
    path : callable or None
        `(params, column, run, q) -> error (n, k)`: motor less link, behind what MuJoCo moves.
    tip : callable or None
        `(params, column, run, T) -> T`: acts on tool poses.
    read : callable or None
        `(params, column, run, readings) -> readings`.
    tracker_only, bare : bool
        Seen by a tracker alone; leaves its trace also where only joints are logged and nothing is known of loads.
    peaks : bool
        Acts only where the command is greatest, or the joint farthest out.
    feedforward : str
        Of the controller, where the cause needs one of a sort; empty takes any.
    channel : str
        Signal in which its size is measured.
    """

    draw: Draw
    where: Literal["joint", "all", "tool", "base"] = "joint"
    grow: tuple[str, ...] = ()
    shrink: tuple[str, ...] = ()
    power: Mapping[str, float] = field(default_factory=dict)
    build: Callable[[Params, int, Plant], Plant] | None = None
    path: Callable[[Params, int, Run, Array], Array] | None = None
    tip: Callable[[Params, int, Run, Array], Array] | None = None
    read: Callable[[Params, int, Run, Readings], Readings] | None = None
    tracker_only: bool = False
    bare: bool = False
    peaks: bool = False
    feedforward: Literal["", "none", "rigid-body"] = ""
    channel: Literal["outside", "reported", "noise"] = "outside"


def column(n: int, k: int, j: int, values: Array) -> Array:
    """Zeros `(n, k)` with one column."""
    out = np.zeros((n, k))
    out[:, j] = values
    return out


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(rng.choice([-1.0, 1.0]))
