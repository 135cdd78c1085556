"""Cable slip: at some instant the cable jumps on its drum, and stays there."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class CableSlip(JointEffect):
    """A step of the offset between reported and true position; the next homing takes it away."""

    step: float
    instant: float
    session: int = 0  # index, from 0

    stage = Stage.TRANSMISSION
    about = Description(
        name="cable_slip",
        number=24,
        family=Family.TIME,
        equation="reported = q + step [t >= instant]",
        source="a step at a change-point: Page 1954, Biometrika 41",
        parameters=(
            Parameter(
                "step",
                "reported minus true position after the slip",
                revolute=Range("rad", -0.5, 0.5, 0.01),
                prismatic=Range("m", -0.05, 0.05, 5e-4),
                positive=False,
            ),
            Parameter(
                "instant",
                "when it slips, in session time",
                revolute=Range("s", 0.0, 1e6, 600.0),
                positive=True,
                ladder=Ladder(Per.SESSION, tuple(i / 32 for i in range(1, 32))),
                change_point=True,
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("drift", "homing_offset"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.REHOMING),
        sites=(Site.JOINT,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.session, int) and self.session >= 0):
            raise DataError(f"effect cable_slip: session must be an index from 0, got {self.session!r}.")

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        slipped = (motion.time >= self.instant) & (motion.session == self.session)
        behind: FloatArray = q[..., j] - self.step * slipped
        return behind
