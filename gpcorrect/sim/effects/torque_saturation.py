"""Torque saturation: the motor or its amplifier cannot give more than so much."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import TorqueEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.laws import TorqueLaw


@dataclass(frozen=True)
class TorqueSaturation(TorqueEffect):
    """The torque that acts is the commanded one, cut at a limit; `measured_jf` still says what was commanded."""

    limit: float

    about = Description(
        name="torque_saturation",
        number=25,
        family=Family.LIMIT,
        equation="tau = clip(tau_commanded, -limit, limit)",
        source="RAVEN-II control software, DAC limit; Hippe 2006, Windup in Control, Ch. 1",
        parameters=(
            Parameter(
                "limit",
                "largest torque",
                revolute=Range("N m", 1e-3, 1e4, 3.0),
                prismatic=Range("N", 0.01, 1e6, 30.0),
                positive=True,
                identity=float("inf"),
                ladder=Ladder(Per.TORQUE, (0.95, 0.85, 0.7, 0.5, 0.3)),
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("viscous_friction", "joint_stop"),
        separating_runs=(Run.SPEED_LADDER, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def law(self) -> TorqueLaw:
        """Return the limit."""
        return TorqueLaw(limit=self.limit)
