"""Joint stop: near one end of its range the joint runs into something springy."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from gpcorrect.sim.effects.base import TorqueEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.laws import TorqueLaw

ENDS = ("upper", "lower")


@dataclass(frozen=True)
class JointStop(TorqueEffect):
    """A spring that pushes the joint back beyond a position, and only there.

    It acts behind the transmission, which carries its torque: a motor whose cable stretches goes on a little while the
    joint stands. The stiffness is that of stop and transmission in series, as the motor feels it, and the position
    where the motor begins to feel it.
    """

    stiffness: float
    limit: float
    end: str = "upper"  # it pushes above the limit; "lower": below

    about = Description(
        name="joint_stop",
        number=26,
        family=Family.LIMIT,
        equation="tau_stop = stiffness max(0, q - limit)",
        source="penalty contact of a unilateral constraint; Brogliato 2016, Nonsmooth Mechanics, Ch. 2",
        parameters=(
            Parameter(
                "stiffness",
                "stiffness of the stop",
                revolute=Range("N m/rad", 0.0, 1e4, 100.0),
                prismatic=Range("N/m", 0.0, 1e6, 1e4),
                positive=True,
            ),
            Parameter(
                "limit",
                "where it begins",
                revolute=Range("rad", -6.5, 6.5, 1.0),
                prismatic=Range("m", -1.0, 1.0, 0.2),
                positive=False,
                ladder=Ladder(Per.END, (0.1, 0.3), within=(0.0, 0.4)),  # beyond, most of the travel would lie on it
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("nonlinear_stretch", "torque_saturation"),
        separating_runs=(Run.AMPLITUDES, Run.ONE_JOINT),
        sites=(Site.JOINT,),
        choices=(("end", ENDS),),
    )

    def law(self) -> TorqueLaw:
        """Return the spring and where it begins."""
        upper, lower = (self.limit, -inf) if self.end == "upper" else (inf, self.limit)
        return TorqueLaw(stiffness=self.stiffness, upper=upper, lower=lower)
