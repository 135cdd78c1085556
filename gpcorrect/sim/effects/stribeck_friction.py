"""Stribeck friction: it takes more to start moving than to keep moving."""

from __future__ import annotations

from dataclasses import dataclass, field

from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw


@dataclass(frozen=True)
class StribeckFriction(FrictionEffect):
    """Dry friction that falls from a static to a kinetic value as the joint picks up speed."""

    torque: float = field(kw_only=True)
    static_torque: float = field(kw_only=True)
    speed: float = field(kw_only=True)

    about = Description(
        name="stribeck_friction",
        number=17,
        family=Family.REVERSAL,
        equation="F = (torque + (static_torque - torque) exp(-(v / speed)^2)) sign v",
        source="Bo and Pavelescu 1982, Wear 82(3); Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(
            Parameter(
                "torque",
                "friction at speed",
                revolute=Range("N m", 0.0, 20.0, 0.3),
                prismatic=Range("N", 0.0, 500.0, 3.0),
                positive=True,
            ),
            Parameter(
                "static_torque",
                "friction at rest",
                revolute=Range("N m", 0.0, 30.0, 0.5),
                prismatic=Range("N", 0.0, 600.0, 5.0),
                positive=True,
            ),
            Parameter(
                "speed",
                "speed over which the one becomes the other",
                revolute=Range("rad/s", 1e-4, 2.0, 0.05),
                prismatic=Range("m/s", 1e-5, 0.2, 0.005),
                positive=True,
                ladder=Ladder(Per.PRIOR, (0.2, 1.0, 5.0)),
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("coulomb_friction", "viscous_friction"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return both limits and the speed between them."""
        return FrictionLaw(torque=self.torque, static=self.static_torque, speed=self.speed)
