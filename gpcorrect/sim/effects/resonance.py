"""Resonance: motor and link swing against each other on the cable between them."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, ring
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Resonance(JointEffect):
    """The joint follows the motor as a second-order system: overshoot and ringing after fast changes.

    Samples slower than twice its frequency do not show it.
    """

    frequency: float
    damping_ratio: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="resonance",
        number=27,
        family=Family.DYNAMICS,
        equation="q'' + 2 damping_ratio w q' + w^2 q = w^2 m, w = 2 pi frequency",
        source="Spong 1987, J. Dyn. Syst. Meas. Control 109(4), elastic joints, one mode",
        parameters=(
            Parameter(
                "frequency",
                "natural frequency",
                revolute=Range("Hz", 3.0, 60.0, 14.0),
                positive=True,
                identity=float("inf"),
                factor=1.9,
                ladder=Ladder(Per.VALUE, (5.0, 10.0, 20.0, 40.0)),
            ),
            Parameter(
                "damping_ratio",
                "fraction of critical damping",
                revolute=Range("1", 0.0, 0.7, 0.1),
                positive=True,
                ladder=Ladder(Per.VALUE, (0.03, 0.3)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("delay", "cable_stretch"),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
        sites=(Site.JOINT,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.frequency > 0:
            raise DataError(f"effect resonance: frequency must be > 0, got {self.frequency!r}.")

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return ring(q[..., j], motion.time, self.frequency, self.damping_ratio, memory)
