"""What every effect is, and the interface of each stage at which one acts.

An effect is a frozen value: absent means off. Arrays are time first: `(n, N, dof)` for n samples of N parallel runs.
Effects return new arrays and know nothing of each other. Where an effect remembers what was before, its operator can be
called on one stretch of a motion after the other, however the motion is cut: a recording is one stretch, the samples of
an arm that runs live are stretches of one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import partial
from typing import Any, ClassVar

import numpy as np

from gpcorrect.arms import Chain
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body, Drive
from gpcorrect.sim.effects.description import Description
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.types import FloatArray

WHOLE_ARM = ("all", "tool", "base")  # values of `joint` besides a number
SIDES = ("motor", "joint")  # of the transmission, in the order of the servo loop's numbers for them

PathOperator = Callable[[FloatArray, Motion], FloatArray]
"""Takes the `(n, N, dof)` path of a stretch and its motion, and returns the path behind the effect."""

ReadingOperator = Callable[[Readings, Motion], Readings]
"""Takes the readings of a stretch and its motion, and returns the readings with the effect."""


class Stage(IntEnum):
    """Where in the chain from command to reading an effect acts; effects act in this order."""

    LOAD = 0  # masses that hang on the arm, and gravity
    CHAIN = 1  # its geometry
    TORQUE = 2  # what the drive delivers, inside the servo loop
    FRICTION = 3  # what the motion costs, inside the servo loop
    ENCODER = 4  # reported motor position -> true motor position
    TRANSMISSION = 5  # motor -> joint
    JOINT = 6  # at the joint
    LINK = 7  # joint -> effective joint value of a bent link
    CLOCK = 8  # when outside sensors see it
    TIP = 9  # at the tool
    BASE = 10  # between the arm's base and the tracker
    READING = 11  # what the sensors say


@dataclass(frozen=True)
class Effect(ABC):
    """One way in which a machine differs from its nominal model.

    What its other numbers mean, with unit and range, and its equation, stand in `about`.

    Parameters
    ----------
    joint : int or str
        Number of the joint it acts on, from 1; "all", "tool" or "base" for effects that belong to no single joint.
    """

    joint: int | str

    about: ClassVar[Description]
    stage: ClassVar[Stage]

    def __post_init__(self) -> None:
        if not (self.joint in WHOLE_ARM or (isinstance(self.joint, int) and self.joint >= 1)):
            wanted = f"a number from 1 or one of {', '.join(WHOLE_ARM)}"
            raise DataError(f"effect {self.about.name}: joint must be {wanted}, got {self.joint!r}.")
        _check_site(self.about, self.joint)
        for name, values in self.about.choices:
            if getattr(self, name) not in values:
                raise DataError(
                    f"effect {self.about.name}: {name} must be {' or '.join(values)}, got {getattr(self, name)!r}."
                )
        for parameter in self.about.parameters:
            parameter.check(self.about.name, getattr(self, parameter.name))

    def canonical(self) -> Effect:
        """Return the same effect in the one way to write it, where there are several."""
        return self

    def like(self) -> Effect | None:
        """Return another effect that does the same on some machines, on which no recording tells the two apart."""
        return None

    def overtones(self) -> tuple[Effect, ...]:
        """Return effects of the same kind that a periodic error of another cause would show beside this one."""
        return ()

    def forgets_after(self) -> dict[int, float]:
        """Return how far joints must have moved, rad or m, until it no longer counts how the motion began."""
        return {}

    def is_a_matter_of_steps(self, drive: Drive, joints: tuple[int, ...]) -> bool:
        """Return whether two programs that step one controller each in its own way differ by as much.

        Parameters
        ----------
        drive : Drive, the nominal one
        joints : tuple of int, numbers of its columns
        """
        return False

    def column(self, joints: tuple[int, ...], number: int | str | None = None) -> int:
        """Return the column of a joint in arrays whose columns are the joints of these numbers.

        Parameters
        ----------
        joints : tuple of int, joint numbers of the columns
        number : int, optional, the joint; the effect's own by default

        Raises
        ------
        DataError
            The joint is not among them.
        """
        wanted = self.joint if number is None else number
        if wanted not in joints:
            raise DataError(
                f"effect {self.about.name} acts on joint {wanted!r}, the model has {', '.join(map(str, joints))}.",
                hint="Name one of the model's joints, or add the joint to the model's `joints`.",
            )
        return joints.index(wanted)

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the joints that the effect speaks of."""
        return (self.joint,) if isinstance(self.joint, int) else ()

    def to_dict(self) -> dict[str, Any]:
        """Return name, joint and parameters as plain values; `effect_from_dict` reads them back."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {"name": self.about.name} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def _check_site(about: Description, joint: int | str) -> None:
    named = [str(site) for site in about.sites if site in WHOLE_ARM]
    numbered = len(named) < len(about.sites)
    if about.sites and not (numbered if isinstance(joint, int) else joint in named):
        places = (["the number of a joint"] if numbered else []) + [f'"{name}"' for name in named]
        raise DataError(f"effect {about.name}: joint must be {' or '.join(places)}, got {joint!r}.")


class LoadEffect(Effect):
    """Changes what the arm carries: masses, or gravity."""

    stage = Stage.LOAD
    believed: ClassVar[bool] = False  # by the controller alone: the arm does not carry it

    @abstractmethod
    def act(self, body: Body) -> Body:
        """Return the body with the effect.

        Parameters
        ----------
        body : Body
        """

    def link_of(self, body: Body) -> int:
        """Return the place of the effect's link among those that weigh something.

        Parameters
        ----------
        body : Body

        Raises
        ------
        DataError
            The model gives the link no mass.
        """
        number, mass = int(self.joint), body.links.mass
        if not (number <= len(mass) and mass[number - 1] > 0.0):
            raise DataError(
                f"effect {self.about.name}: link {number} weighs nothing in the model.",
                hint="Give the masses in `links`, or leave the effect out.",
            )
        return number - 1


class ChainEffect(Effect):
    """Changes the arm's geometry."""

    stage = Stage.CHAIN

    def check(self, chain: Chain) -> None:
        """Refuse an arm on which the effect cannot be, whatever other effects do to it: DataError.

        Parameters
        ----------
        chain : Chain, without effects
        """

    @abstractmethod
    def act(self, chain: Chain) -> Chain:
        """Return the kinematic chain with the effect.

        Parameters
        ----------
        chain : Chain
        """


class TorqueEffect(Effect):
    """Changes the torque on a motor, inside the servo loop, which evaluates the law at every step."""

    stage = Stage.TORQUE

    @abstractmethod
    def law(self) -> TorqueLaw:
        """Return what becomes of the commanded torque."""


class DriveEffect(Effect):
    """Changes the controller: its gains, or what it feeds forward."""

    stage = Stage.TORQUE

    def _of_each(self, value: float, joints: tuple[int, ...], known: FloatArray | None = None) -> FloatArray:
        """Return a number `(dof,)` of each controller: what is known, and the value more at its joint, or at all."""
        numbers = np.zeros(len(joints)) if known is None else np.array(known)
        numbers[slice(None) if self.joint == "all" else self.column(joints)] += value
        return numbers

    @abstractmethod
    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Return the drives as they are.

        Parameters
        ----------
        drive : Drive
        joints : tuple of int, joint numbers of their columns
        """


@dataclass(frozen=True)
class FrictionEffect(Effect):
    """Takes torque from the motion, inside the servo loop, which evaluates the law at every step.

    Parameters
    ----------
    joint : int
    side : str
        "motor": before the cable, which then does not feel it; "joint": behind it, so that the cable carries it too.
    """

    side: str = "motor"

    stage = Stage.FRICTION

    def forgets_after(self) -> dict[int, float]:
        """Return that any move will do: at rest it holds whatever came before."""
        return dict.fromkeys(self.joints, 0.0)

    @abstractmethod
    def law(self) -> FrictionLaw:
        """Return the friction's law."""


class PathEffect(Effect):
    """Changes the joint path: any stage from the encoder to the clock."""

    def is_seen_by(self, *, tracker: bool) -> bool:
        """Return whether the tracker, or the joints' outside encoders, see it: what is the arm's own, both do.

        Parameters
        ----------
        tracker : bool, else the encoders
        """
        return True

    def on_motors(self, load: FloatArray, joints: tuple[int, ...]) -> FloatArray:
        """Return what a load `(..., dof)` behind the effect asks for before it: the same, unless it gears the joints.

        Parameters
        ----------
        load : (..., dof) array, N m or N
        joints : tuple of int, joint numbers of its columns
        """
        return load

    @abstractmethod
    def advance(self, q: FloatArray, motion: Motion, memory: Memory) -> FloatArray:
        """Return the path of a stretch behind the effect, and bring the memory up to the stretch's end.

        Parameters
        ----------
        q : (n, N, dof) array, path before the effect, rad or m
        motion : Motion
        memory : dict, empty at the start of a motion
        """

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Return the path `(n, N, dof)` behind the effect, taking a whole motion as one stretch.

        Parameters
        ----------
        q : (n, N, dof) array, path before the effect, rad or m
        motion : Motion
        """
        return self.advance(q, motion, {})

    def operator(self) -> PathOperator:
        """Return the effect at the start of a motion, to be called on one stretch of it after the other.

        Raises
        ------
        DataError
            The effect would need to know the future.
        """
        return partial(self.advance, memory={})


class JointEffect(PathEffect):
    """A path effect that changes the path of its own joint alone, in the transmission unless it says otherwise."""

    stage = Stage.TRANSMISSION

    def advance(self, q: FloatArray, motion: Motion, memory: Memory) -> FloatArray:
        """Change one column."""
        j = self.column(motion.joints)
        return with_column(q, j, self._behind(q, j, motion, memory))

    def own_path(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Return the path `(n, N)` of its own joint behind the effect; of `q` it reads the columns of its `joints`.

        Parameters
        ----------
        q, motion : see :meth:`PathEffect.act`
        """
        return self._behind(q, self.column(motion.joints), motion, {})

    @abstractmethod
    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        """Return the path `(n, N)` of joint column `j` behind the effect, given all joints' paths `q` before it."""


class TipEffect(Effect):
    """Changes the tool's pose where no joint encoder sees it: stage TIP or BASE."""

    @abstractmethod
    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Return the `(n, N, 4, 4)` poses with the effect.

        Parameters
        ----------
        T_base_tip : (n, N, 4, 4) array, poses before the effect, base frame
        motion : Motion
        """


class ReadingEffect(Effect):
    """Changes what the sensors say."""

    stage = Stage.READING

    @abstractmethod
    def advance(self, readings: Readings, motion: Motion, rng: np.random.Generator, memory: Memory) -> Readings:
        """Return the readings of a stretch with the effect, and bring the memory up to its end.

        Parameters
        ----------
        readings : Readings
        motion : Motion
        rng : numpy.random.Generator
        memory : dict, empty at the start of a recording
        """

    def operator(self, rng: np.random.Generator) -> ReadingOperator:
        """Return the effect at the start of a recording, to be called on one stretch of it after the other.

        Parameters
        ----------
        rng : numpy.random.Generator
        """
        return partial(self.advance, rng=rng, memory={})


def with_column(q: FloatArray, column: int, path: FloatArray) -> FloatArray:
    """Return the paths of all joints with another one in one column.

    Parameters
    ----------
    q : (n, N, dof) array, of all joints
    column : int
    path : (n, N) array
    """
    changed = np.array(q)
    changed[..., column] = path
    return changed
