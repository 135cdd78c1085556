"""Coulomb friction: a constant torque against the motion, and any smaller one at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw


@dataclass(frozen=True)
class CoulombFriction(FrictionEffect):
    """Dry friction of fixed size: by a proportional gain an error of torque / kp that changes sign at reversals."""

    torque: float = field(kw_only=True)

    about = Description(
        name="coulomb_friction",
        number=15,
        family=Family.REVERSAL,
        equation="F = torque sign(v), |F| <= torque at rest",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(
            Parameter(
                "torque",
                "size of the friction",
                revolute=Range("N m", 0.0, 20.0, 0.3),
                prismatic=Range("N", 0.0, 500.0, 3.0),
                positive=True,
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("viscous_friction", "delay", "backlash"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return the constant limit."""
        return FrictionLaw(torque=self.torque)
