"""What a hidden cause is: how its numbers are drawn, how it grows, and where it acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from truth import alike
from truth.hidden import Params
from truth.kinds.kind import Cause as SharedCause
from truth.reference import Reference

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

    @property
    def reference(self) -> Reference:
        """What the arm was told to do."""
        return self.run.reference

    def unit(self, j: int, revolute: Any, prismatic: Any) -> Any:
        """Return what is for a turning or for a sliding joint."""
        return self.arm.unit(j, revolute, prismatic)

    def stop_stiffness(self, j: int) -> float:
        """Stiffness of a stop before it is sized."""
        return 0.02 * float(self.run.plant.kp[j])

    def command(self, j: int) -> Array:
        """Commanded torque at logged ticks."""
        return self.run.recorded.command[self.reference.logged, j]

    def moving(self, j: int) -> Array:
        """Whether the joint moves at each tick."""
        return np.abs(self.run.speed[:, j]) > 1e-6

    def load(self, j: int) -> float:
        """RMS of the torque that the links ask of a joint, at least a little."""
        return max(alike.rms(self.run.load[self.reference.logged, j]), self.arm.unit(j, 0.2, 0.5))

    def weight(self, j: int) -> float:
        """RMS of the part that holds the links up, at least a little."""
        return max(alike.rms(self.run.weight[self.reference.logged, j]), self.arm.unit(j, 0.1, 0.3))

    def path(self, j: int) -> Array:
        """Motor path at logged ticks."""
        return self.run.recorded.reported[self.reference.logged, j]

    def torque(self, j: int) -> float:
        """Torque that moves the motor by the noise, against its controller."""
        return float(self.run.plant.kp[j] * self.noise[j])

    def other(self, rng: np.random.Generator, j: int) -> int:
        """Return the column of another joint; beside it where there are many."""
        near = [k for k in range(self.arm.dof) if k != j and (self.arm.dof < 4 or abs(k - j) < 3)]
        return int(rng.choice(near))


@dataclass(frozen=True)
class Cause(SharedCause):
    """One sort of hidden cause.

    Parameters
    ----------
    build : callable or None, `(params, column, plant) -> plant`: acts in MuJoCo's model or its controller
    feedforward : str, of the controller, where the cause needs one of a sort; empty takes any
    """

    build: Callable[[Params, int, Plant], Plant] | None = None
    feedforward: Literal["", "none", "rigid-body"] = ""


def column(n: int, k: int, j: int, values: Array) -> Array:
    """Zeros `(n, k)` with one column."""
    out = np.zeros((n, k))
    out[:, j] = values
    return out
