"""Feed-forward error: the controller adds more or less of a torque at the commanded motion than the model says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.sim.effects.base import DriveEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site

if TYPE_CHECKING:
    from gpcorrect.sim.machine import Drive  # it holds effects

TERMS = ("gravity", "inertia", "velocity")  # in the order of `Drive.beyond`


@dataclass(frozen=True)
class FeedforwardError(DriveEffect):
    """The controller feeds a further fraction of one term forward; -1 is a term that the machine lacks.

    Terms are "gravity", what holds the nominal arm, "inertia", what accelerates it and its motors, and "velocity", kd
    times the commanded velocity.
    """

    fraction: float
    term: str = "gravity"

    about = Description(
        name="feedforward_error",
        number=30,
        family=Family.DYNAMICS,
        equation="tau = tau_nominal + fraction tau_term(q_commanded)",
        source="computed-torque control with wrong terms; Siciliano et al. 2009, Robotics, Sec. 8.5",
        parameters=(
            Parameter(
                "fraction", "fraction fed forward beyond the model", revolute=Range("1", -3.0, 3.0, 0.3), positive=False
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("gain_error", "payload", "viscous_friction"),
        separating_runs=(Run.SPEED_LADDER, Run.POSE_SPREAD, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
        choices=(("term", TERMS),),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Add the fraction to what is fed forward."""
        beyond = np.array(np.broadcast_to(drive.beyond, (3, len(joints))))
        beyond[TERMS.index(self.term), self.column(joints)] += self.fraction
        return replace(drive, beyond=beyond)
