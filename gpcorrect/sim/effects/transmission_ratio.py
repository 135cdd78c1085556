"""Transmission ratio: the gear or pulley ratio in the software is not the machine's."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class TransmissionRatio(JointEffect):
    """The motion since homing is reported `1 + error` times as large as it is."""

    error: float
    home: float = 0.0

    stage = Stage.TRANSMISSION
    about = Description(
        name="transmission_ratio",
        number=2,
        family=Family.GEOMETRY,
        equation="reported = q + error (q - home)",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N",
        parameters=(
            Parameter("error", "relative error of the ratio", revolute=Range("1", -0.2, 0.2, 0.02), positive=False),
            Parameter(
                "home",
                "where the joint was homed",
                revolute=Range("rad", -6.5, 6.5, 1.0),
                prismatic=Range("m", -1.0, 1.0, 0.2),
                positive=False,
                ladder=Ladder(Per.PLACE, (0.5,), absent=True),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("gravity_sag",),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return (q[..., j] + self.error * self.home) / (1.0 + self.error)
