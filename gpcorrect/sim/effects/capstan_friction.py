"""Capstan friction: a cable that runs around pulleys and sheaths loses tension in proportion to what it carries."""

from __future__ import annotations

from dataclasses import dataclass, field

from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw


@dataclass(frozen=True)
class CapstanFriction(FrictionEffect):
    """Friction that grows with the load, more against it than with it.

    The motor pays tau exp(mu theta) to lift a load tau and tau exp(-mu theta) to let it down; in between it sticks.
    """

    wrap: float = field(kw_only=True)

    about = Description(
        name="capstan_friction",
        number=18,
        family=Family.REVERSAL,
        equation="T2 = T1 exp(wrap sign v): F = tau (exp(wrap sign(v tau)) - 1)",
        source="Euler and Eytelwein's belt; Kaneko, Yamashita, Tanie 1991, tendon transmissions, ICAR",
        parameters=(
            Parameter(
                "wrap", "friction coefficient times wrap angle", revolute=Range("1", 0.0, 3.0, 0.15), positive=True
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("coulomb_friction",),
        separating_runs=(Run.LOAD_SWAP, Run.POSE_SPREAD),
        sites=(Site.JOINT,),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return what the wrap takes of the load."""
        return FrictionLaw(wrap=self.wrap)
