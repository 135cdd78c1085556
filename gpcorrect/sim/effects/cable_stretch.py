"""Cable stretch: the cable is a spring between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class CableStretch(JointEffect):
    """The joint lags behind the motor by the torque it takes, over the cable's stiffness."""

    stiffness: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="cable_stretch",
        number=7,
        family=Family.COMPLIANCE,
        equation="q = m - tau / stiffness",
        source="Hooke's law; Miyasaka et al. 2020, IEEE RA-L 5(2), cable-pulley network",
        parameters=(
            Parameter(
                "stiffness",
                "stiffness of the cable pair at the joint",
                revolute=Range("N m/rad", 2.0, 1e5, 200.0),
                prismatic=Range("N/m", 100.0, 1e7, 2e4),
                positive=True,
                identity=float("inf"),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("transmission_ratio", "gravity_sag"),
        separating_runs=(Run.LOAD_SWAP, Run.POSE_SPREAD, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - motion.load[..., j] / self.stiffness
