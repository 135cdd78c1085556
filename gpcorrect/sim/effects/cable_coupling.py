"""Cable coupling: another joint's motion winds this joint's cable, more or less than the software says."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import Stage
from gpcorrect.sim.effects.description import Description, Family, Neighbour, Parameter, Range, Run, Site
from gpcorrect.sim.effects.stages import PathEffect, with_column
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["CableCoupling"]


@dataclass(frozen=True)
class CableCoupling(PathEffect):
    """An off-diagonal term of the coupling matrix is wrong or missing.

    Parameters
    ----------
    joint : int
        Number of the joint j whose position comes out wrong.
    source : int
        Number of the joint k whose motion causes it.
    coefficient : float
        Reported minus true position of j for each unit of k.
    """

    source: int
    coefficient: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="cable_coupling",
        slot="T",
        family=Family.GEOMETRY,
        equation="q_j_reported = q_j + c q_k",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N",
        parameters=(
            Parameter(
                "coefficient",
                "reported minus true position of this joint for each unit of the source",
                revolute=Range("rad per unit of source", -1.0, 1.0, 0.05),
                prismatic=Range("m per unit of source", -0.05, 0.05, 0.002),
                positive=False,
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=(Neighbour("gravity_sag", "move the source alone and hold this joint"),),
        separating_runs=(Run.ONE_JOINT,),
        sites=(Site.PAIR,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.source, int) and self.source >= 1) or self.source == self.joint:
            raise DataError(
                f"effect cable_coupling: source must be the number of a joint other than {self.joint}, "
                f"got {self.source!r}."
            )

    @property
    def joints(self) -> tuple[int, ...]:
        """Both joints."""
        return (*super().joints, self.source)

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Take the source's share off this joint's path."""
        j, k = self.column(motion.joints), self.column(motion.joints, self.source)
        return with_column(q, j, q[..., j] - self.coefficient * q[..., k])
