"""Transmission ratio: the gear or pulley ratio in the software is not the machine's."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import PathEffect, Stage, with_column
from gpcorrect.sim.effects.description import Description, Family, Neighbour, Parameter, Range, Run, Site
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["TransmissionRatio"]


@dataclass(frozen=True)
class TransmissionRatio(PathEffect):
    """The reported position is the true one times `1 + error`.

    Parameters
    ----------
    joint : int
        Number of the joint.
    error : float
        Relative error s of the ratio.
    """

    error: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="transmission_ratio",
        number=2,
        slot="T",
        family=Family.GEOMETRY,
        equation="q_reported = (1 + s) q",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N",
        parameters=(
            Parameter(
                "error",
                "relative error of the ratio",
                revolute=Range("1", -0.2, 0.2, 0.02),
                positive=False,
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=(Neighbour("gravity_sag", "the same joint value at another pose of the outer joints; payload"),),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Divide the path by `1 + error`."""
        j = self.column(motion.joints)
        return with_column(q, j, q[..., j] / (1.0 + self.error))
