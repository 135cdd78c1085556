"""The interfaces of the stages: one method `act` each, with what it is given and what it must return.

Arrays are time first: `(n, N, dof)` for n samples of N parallel runs. An effect returns new arrays, and knows nothing
of the others.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from gpcorrect.arms import Chain
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Links
from gpcorrect.sim.effects.base import Effect, Stage
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw, contact_along, resisting_along
from gpcorrect.sim.motion import DriveState, Motion, Readings
from gpcorrect.types import FloatArray

__all__ = [
    "SIDES",
    "ChainEffect",
    "Friction",
    "FrictionEffect",
    "LawfulFriction",
    "LawfulTorque",
    "LoadEffect",
    "PathEffect",
    "ReadingEffect",
    "TipEffect",
    "TorqueEffect",
    "with_column",
]


SIDES = ("motor", "joint")


class Friction(NamedTuple):
    """Friction of one joint: dry `limit` (N m or N) and `damping` (N m s/rad or N s/m); numbers or arrays.

    `backward` is the limit against motion in the negative direction, where it is another one.
    """

    limit: float | FloatArray
    damping: float | FloatArray
    backward: float | FloatArray | None = None


class LoadEffect(Effect):
    """Changes the masses that the arm carries."""

    stage = Stage.LOAD

    @abstractmethod
    def act(self, links: Links) -> Links:
        """Return the masses with the effect."""


class ChainEffect(Effect):
    """Changes the arm's geometry."""

    stage = Stage.CHAIN

    @abstractmethod
    def act(self, chain: Chain) -> Chain:
        """Return the kinematic chain with the effect."""


class TorqueEffect(Effect):
    """Changes the torque on the motors, inside the servo loop."""

    stage = Stage.TORQUE

    @abstractmethod
    def act(self, torque: FloatArray, state: DriveState) -> FloatArray:
        """Return the `(N, dof)` torque that acts, given the commanded one (N m or N, joint units)."""


@dataclass(frozen=True)
class FrictionEffect(Effect):
    """Takes torque from the motion, inside the servo loop.

    Parameters
    ----------
    joint : int
        Number of the joint.
    side : str
        "motor": before the cable, which then does not feel it; "joint": behind it, so that the cable carries it too.
    """

    side: str = "motor"

    stage = Stage.FRICTION
    varies: ClassVar[bool] = False  # whether `act` must be asked anew at every step of the loop

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.side not in SIDES:
            raise DataError(f"effect {self.about.name}: side must be {' or '.join(SIDES)}, got {self.side!r}.")

    @abstractmethod
    def act(self, state: DriveState) -> Friction:
        """Return the friction of this joint in a state of leading shape `(...)`."""


class LawfulTorque(TorqueEffect):
    """A torque effect that the compiled loop evaluates itself, from a law."""

    @abstractmethod
    def law(self) -> TorqueLaw:
        """Return what becomes of the commanded torque."""

    def act(self, torque: FloatArray, state: DriveState) -> FloatArray:
        """Cut this joint's torque at the limit and take off what the stop pushes back."""
        j, law = self.column(state.joints), self.law()
        delivered = np.clip(torque[..., j], -law.limit, law.limit)
        return with_column(torque, j, delivered - contact_along(law, state.position[..., j]))


class LawfulFriction(FrictionEffect):
    """A friction that the compiled loop evaluates itself, from a law."""

    @abstractmethod
    def law(self) -> FrictionLaw:
        """Return the friction's law."""

    def act(self, state: DriveState) -> Friction:
        """Evaluate the law."""
        j, law = self.column(state.joints), self.law()
        limits = resisting_along(law, state.position[..., j], state.velocity[..., j], state.load[..., j])
        return Friction(limits[0], law.damping, limits[1])


class PathEffect(Effect):
    """Changes the joint path: any stage from the encoder to the link."""

    joint_by_joint: ClassVar[bool] = False  # whether it does the same to each joint's path, whatever the others do

    @abstractmethod
    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Return the `(n, N, dof)` path behind the effect, given the path before it (rad or m)."""


class TipEffect(Effect):
    """Changes the tool's pose where no joint encoder sees it: stage TIP or BASE."""

    @abstractmethod
    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Return the `(n, N, 4, 4)` poses with the effect."""


class ReadingEffect(Effect):
    """Changes what the sensors say."""

    stage = Stage.READING

    @abstractmethod
    def act(self, readings: Readings, motion: Motion, rng: np.random.Generator) -> Readings:
        """Return the readings with the effect."""


def with_column(q: FloatArray, column: int, path: FloatArray) -> FloatArray:
    """Return `q` `(n, N, dof)` with `path` `(n, N)` in one column."""
    changed = np.array(q)
    changed[..., column] = path
    return changed
