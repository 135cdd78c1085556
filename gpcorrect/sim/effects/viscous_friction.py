"""Viscous friction: a torque against the motion that grows with speed."""

from __future__ import annotations

from dataclasses import dataclass, field

from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw


@dataclass(frozen=True)
class ViscousFriction(FrictionEffect):
    """Damping; through a proportional gain it becomes a lag of b / kp seconds in this joint."""

    damping: float = field(kw_only=True)

    about = Description(
        name="viscous_friction",
        number=16,
        family=Family.REVERSAL,
        equation="F = damping v",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(
            Parameter(
                "damping",
                "torque for each unit of speed",
                revolute=Range("N m s/rad", 0.0, 300.0, 0.5),
                prismatic=Range("N s/m", 0.0, 2e4, 20.0),
                positive=True,
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("delay", "coulomb_friction"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return the constant damping."""
        return FrictionLaw(damping=self.damping)
