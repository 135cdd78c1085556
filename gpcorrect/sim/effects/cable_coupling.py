"""Cable coupling: another joint's motion winds this joint's cable, more or less than the software says."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, play
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class CableCoupling(JointEffect):
    """An off-diagonal term of the coupling matrix is wrong or missing; it may drag behind the source.

    A cable that is wound by friction first sticks to the source's motion and lets go of it at a reversal: this part is
    the source less its play, which follows the last bit of motion after a reversal and no more.
    """

    source: int  # number of the joint whose motion causes it
    coefficient: float
    drag: float = 0.0
    drag_radius: float = 0.0
    home: float = 0.0

    stage = Stage.TRANSMISSION
    about = Description(
        name="cable_coupling",
        number=3,
        family=Family.GEOMETRY,
        equation="reported_j = q_j + coefficient (q_source - home) + drag (q_source - play(q_source, drag_radius))",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N; play as in backlash",
        parameters=(
            Parameter(
                "coefficient",
                "reported minus true position of this joint for each unit of the source",
                revolute=Range("rad per unit of source", -1.0, 1.0, 0.05),
                prismatic=Range("m per unit of source", -0.05, 0.05, 0.002),
                positive=False,
            ),
            Parameter(
                "drag",
                "reported minus true position of this joint for each unit of the source's motion since its reversal",
                revolute=Range("rad per unit of source", -5.0, 5.0, 0.2),
                prismatic=Range("m per unit of source", -0.25, 0.25, 0.01),
                positive=False,
                shaped_by="drag_radius",
            ),
            Parameter(
                "drag_radius",
                "half the source's motion over which the drag turns round",
                revolute=Range("rad or m of source", 0.0, 1.0, 0.05),
                positive=True,
                ladder=Ladder(Per.RANGE, (0.02, 0.06, 0.15), absent=True),
            ),
            Parameter(
                "home",
                "where the source stood when the joint was homed",
                revolute=Range("rad or m of source", -6.5, 6.5, 1.0),
                positive=False,
                ladder=Ladder(Per.PLACE, (0.5,), absent=True),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("gravity_sag", "backlash"),
        separating_runs=(Run.ONE_JOINT, Run.AMPLITUDES),
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

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        k = self.column(motion.joints, self.source)
        wound = self.coefficient * (q[..., k] - self.home)
        if self.drag:
            wound = wound + self.drag * (q[..., k] - play(q[..., k], self.drag_radius, memory))
        return q[..., j] - wound
