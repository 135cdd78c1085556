"""Position-dependent friction: the joint runs harder in some places than in others."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw


@dataclass(frozen=True)
class PositionDependentFriction(FrictionEffect):
    """Dry friction whose size swings with the joint's position, never below zero."""

    torque: float = field(kw_only=True)
    swing: float = field(kw_only=True)
    waves: float = field(kw_only=True)
    phase: float = field(kw_only=True)

    about = Description(
        name="position_dependent_friction",
        number=19,
        family=Family.REVERSAL,
        equation="F = max(0, torque + swing sin(waves q + phase)) sign v",
        source="Armstrong 1988, ICRA, Friction: experimental determination, modeling and compensation",
        parameters=(
            Parameter(
                "torque",
                "mean friction",
                revolute=Range("N m", 0.0, 20.0, 0.3),
                prismatic=Range("N", 0.0, 500.0, 3.0),
                positive=True,
            ),
            Parameter(
                "swing",
                "size of the part that varies",
                revolute=Range("N m", -20.0, 20.0, 0.2),
                prismatic=Range("N", -100.0, 100.0, 2.0),
                positive=False,
            ),
            Parameter(
                "waves",
                "phase for each unit of the joint",
                revolute=Range("1", 0.1, 300.0, 6.0),
                prismatic=Range("rad/m", 1.0, 5000.0, 60.0),
                positive=True,
                ladder=Ladder(Per.SWEEP, (1.5 * np.pi, 2 * np.pi, 4 * np.pi), within=(np.pi, 1e9)),
            ),
            Parameter(
                "phase",
                "phase at zero",
                revolute=Range("rad", -np.pi, np.pi, 1.0),
                positive=False,
                ladder=Ladder(Per.VALUE, (0.0, np.pi / 2)),
                period=2 * np.pi,
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("coulomb_friction", "pulley_eccentricity"),
        separating_runs=(Run.AMPLITUDES, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return mean and wave."""
        return FrictionLaw(torque=self.torque, swing=self.swing, waves=self.waves, phase=self.phase)
