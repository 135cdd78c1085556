"""Hysteresis: after each reversal a little of the motion is lost again, along a curve."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Neighbour, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, bouc_wen
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["Hysteresis"]


@dataclass(frozen=True)
class Hysteresis(JointEffect):
    """The joint lags behind the motor by the state of a Bouc-Wen element with A = 1 and beta = gamma.

    Parameters
    ----------
    joint : int
        Number of the joint.
    radius : float
        Largest lag, rad or m.
    sharpness : float
        Exponent n: 1 is a long soft curve, a large one a play with a corner.
    """

    radius: float
    sharpness: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="hysteresis",
        number=20,
        slot="T",
        family=Family.REVERSAL,
        equation="q = m - z, dz = (1 - |z / r|^n (1 + sign(z dm)) / 2) dm",
        source="Bouc 1967; Wen 1976; Ismail, Ikhouane, Rodellar 2009, Arch. Comput. Methods Eng. 16",
        parameters=(
            Parameter(
                "radius",
                "largest lag",
                revolute=Range("rad", 0.0, 0.6, 0.01),
                prismatic=Range("m", 0.0, 0.02, 5e-4),
                positive=True,
                ladder=Ladder(Per.RANGE, (0.01, 0.03, 0.1)),
            ),
            Parameter(
                "sharpness",
                "exponent of the curve",
                revolute=Range("1", 0.3, 20.0, 1.5),
                positive=True,
                factor=2.0,
                ladder=Ladder(Per.VALUE, (1.0, 3.0)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=(
            Neighbour("backlash", "minor loops: the return is curved, a play's is straight"),
            Neighbour("coulomb_friction", "vary the controller's gain or the load"),
        ),
        separating_runs=(Run.AMPLITUDES, Run.LOAD_SWAP, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sharpness > 0:
            raise DataError(f"effect hysteresis: sharpness must be > 0, got {self.sharpness!r}.")

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - bouc_wen(q[..., j], self.radius, self.sharpness, memory)
