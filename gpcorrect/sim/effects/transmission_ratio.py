"""Transmission ratio: the gear or pulley ratio in the software is not the machine's."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Neighbour, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["TransmissionRatio"]


@dataclass(frozen=True)
class TransmissionRatio(JointEffect):
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
            Parameter("error", "relative error of the ratio", revolute=Range("1", -0.2, 0.2, 0.02), positive=False),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=(Neighbour("gravity_sag", "the same joint value at another pose of the outer joints; payload"),),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] / (1.0 + self.error)
