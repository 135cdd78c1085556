"""What every effect is: a frozen value that acts at one stage of the machine and can be written down and read back."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, fields
from enum import IntEnum
from math import isnan
from typing import Any, ClassVar

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.description import Description, Parameter

__all__ = ["WHOLE_ARM", "Effect", "Stage"]

WHOLE_ARM = ("all", "tool", "base")  # what `joint` may say besides a number


class Stage(IntEnum):
    """Where in the chain from command to reading an effect acts; effects act in this order."""

    LOAD = 0  # masses that hang on the arm
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
    """One way in which a machine differs from its nominal model; absent means off.

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
            raise DataError(
                f"effect {self.about.name}: joint must be a number from 1 or one of {', '.join(WHOLE_ARM)}, "
                f"got {self.joint!r}."
            )
        _check_site(self.about, self.joint)
        for parameter in self.about.parameters:
            _check(self.about.name, parameter, getattr(self, parameter.name))

    def canonical(self) -> Effect:
        """Return the same effect in the one way to write it, where there are several."""
        return self

    def overtones(self) -> tuple[Effect, ...]:
        """Return effects of the same kind that a periodic error of another cause would show beside this one."""
        return ()

    def column(self, joints: tuple[int, ...], number: int | str | None = None) -> int:
        """Column of this effect's joint (or of joint `number`) in arrays whose columns are these joint numbers.

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


def _check(effect: str, parameter: Parameter, value: Any) -> None:
    numbers = value if parameter.per_session and isinstance(value, tuple) and value else (value,)
    real = all(isinstance(v, float | int) and not isinstance(v, bool) and not isnan(v) for v in numbers)
    if not real or (parameter.positive and min(numbers) < 0):
        wanted = "a number >= 0" if parameter.positive else "a number"
        raise DataError(
            f"effect {effect}: {parameter.name} ({parameter.meaning}) must be {wanted}"
            f"{', or one a session' if parameter.per_session else ''}, got {value!r}."
        )
