"""Effects at a limit: of the torque, and of the range."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from gpcorrect.sim.effects.base import TorqueEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run
from gpcorrect.sim.effects.laws import TorqueLaw

# Units, physical ranges and typical sizes on revolute and prismatic joints.
TORQUE = Range("N m", 1e-3, 1e4, 3.0), Range("N", 0.01, 1e6, 30.0)
STOP = Range("N m/rad", 0.0, 1e4, 100.0), Range("N/m", 0.0, 1e6, 1e4)
PLACE = Range("rad", -6.5, 6.5, 1.0), Range("m", -1.0, 1.0, 0.2)


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
                *TORQUE,
                identity=inf,
                ladder=Ladder(Per.TORQUE, (0.995, 0.99, 0.98, 0.97, 0.96, 0.95, 0.93, 0.9, 0.85, 0.7, 0.5, 0.3)),
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("viscous_friction", "joint_stop"),
        separating_runs=(Run.SPEED_LADDER, Run.LOAD_SWAP),
    )

    def law(self) -> TorqueLaw:
        """Return the limit."""
        return TorqueLaw(limit=self.limit)


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
            Parameter("stiffness", "stiffness of the stop", *STOP),
            Parameter(
                "limit",
                "where it begins",
                *PLACE,
                positive=False,
                # Beyond 0.4 of the range most of the travel would lie on it.
                ladder=Ladder(Per.END, (0.03, 0.1, 0.3), within=(0.0, 0.4)),
            ),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("nonlinear_stretch", "torque_saturation"),
        separating_runs=(Run.AMPLITUDES, Run.ONE_JOINT),
        choices=(("end", ENDS),),
    )

    def law(self) -> TorqueLaw:
        """Return the spring and where it begins."""
        upper, lower = (self.limit, -inf) if self.end == "upper" else (inf, self.limit)
        return TorqueLaw(stiffness=self.stiffness, upper=upper, lower=lower)
