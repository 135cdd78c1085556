"""Delay: the outside sensors tell of a moment that has passed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.effects.base import Stage
from gpcorrect.sim.effects.description import Description, Family, Neighbour, Parameter, Range, Run, Site
from gpcorrect.sim.effects.shifted import shifted
from gpcorrect.sim.effects.stages import PathEffect
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["Delay"]

_DELAY = Range("s", -0.5, 0.5, 0.03)


@dataclass(frozen=True)
class Delay(PathEffect):
    """Every joint is seen where it was `delay` seconds ago; outside the recorded time it stood still.

    Between samples the path is a monotone cubic, which never overshoots a play's corners.

    Parameters
    ----------
    joint : str
        "all".
    delay : float
        s; negative where the robot's own reports are the late ones.
    """

    delay: float

    stage = Stage.CLOCK
    joint_by_joint = True
    about = Description(
        name="delay",
        slot="S",
        family=Family.TIME,
        equation="y(t) = x(t - d), all joints alike",
        source="Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17(2), for the values between samples",
        parameters=(Parameter("delay", "age of what is seen", revolute=_DELAY, prismatic=_DELAY, positive=False),),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=(
            Neighbour("viscous_friction", "look at the torque, or for a lag common to all joints"),
            Neighbour("resonance", "fast motion: the amplitude has a peak, a delay's has none"),
        ),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
        sites=(Site.ALL,),
    )

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Return each run's path as it was before."""
        if self.delay == 0 or len(q) < 2:
            return q
        times = np.broadcast_to(motion.time[..., None], q.shape).reshape(len(q), -1)  # padded runs repeat their last
        return shifted(np.ascontiguousarray(q).reshape(len(q), -1), times, self.delay).reshape(q.shape)
