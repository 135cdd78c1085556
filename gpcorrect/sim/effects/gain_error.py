"""Gain error: the controller on the machine has other gains than the model's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.sim.effects.base import DriveEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site

if TYPE_CHECKING:
    from gpcorrect.sim.machine import Drive  # it holds effects


@dataclass(frozen=True)
class GainError(DriveEffect):
    """Both gains are off by a fraction of their own."""

    proportional: float
    derivative: float = 0.0

    about = Description(
        name="gain_error",
        number=31,
        family=Family.DYNAMICS,
        equation="tau = kp (1 + proportional) (q_d - q) + kd (1 + derivative) (v_d - v)",
        source="PD control on the motor side, RAVEN-II control software",
        parameters=(
            Parameter("proportional", "relative error of kp", revolute=Range("1", -0.9, 9.0, 0.2), positive=False),
            Parameter("derivative", "relative error of kd", revolute=Range("1", -0.9, 9.0, 0.2), positive=False),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("feedforward_error", "viscous_friction"),
        separating_runs=(Run.SPEED_LADDER, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Scale the joint's gains."""
        j, kp, kd = self.column(joints), np.array(drive.kp), np.array(drive.kd)
        kp[j] *= 1.0 + self.proportional
        kd[j] *= 1.0 + self.derivative
        return replace(drive, kp=kp, kd=kd)
