"""Gravity sag: links and bearings bend under the arm's weight."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class GravitySag(JointEffect):
    """The effective joint value falls behind by the gravity torque over the link's stiffness."""

    stiffness: float

    stage = Stage.LINK
    about = Description(
        name="gravity_sag",
        number=10,
        family=Family.COMPLIANCE,
        equation="q_link = q - g(q) / stiffness",
        source="Roth, Mooring, Ravani 1987, IEEE J. Robotics and Automation 3(5): non-geometric errors",
        parameters=(
            Parameter(
                "stiffness",
                "stiffness of the structure",
                revolute=Range("N m/rad", 2.0, 1e5, 300.0),
                prismatic=Range("N/m", 100.0, 1e7, 3e4),
                positive=True,
                identity=float("inf"),
            ),
        ),
        needs=("external_jp|tracker_cp",),
        neighbours=("transmission_ratio", "registration_error", "cable_stretch"),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - motion.gravity_load[..., j] / self.stiffness
