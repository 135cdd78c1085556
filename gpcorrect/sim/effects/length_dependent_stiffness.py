"""Length-dependent stiffness: the further the instrument goes in, the longer the cable that stretches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class LengthDependentStiffness(JointEffect):
    """The joint lags behind the motor by its torque over a stiffness that falls with the cable's length."""

    source: int  # the prismatic joint that pays the cable out; it may be the joint itself
    rigidity: float
    length: float  # negative where the source's zero, a convention of the arm's table, lies behind the drum

    stage = Stage.TRANSMISSION
    about = Description(
        name="length_dependent_stiffness",
        number=9,
        family=Family.COMPLIANCE,
        equation="q = m - tau / k, k = rigidity / (length + q_source)",
        source="Hooke's law of a rod; Miyasaka et al. 2020, IEEE RA-L 5(2), cable-pulley network",
        parameters=(
            Parameter(
                "rigidity",
                "stiffness times cable length",
                revolute=Range("N m^2/rad", 1.0, 5e4, 80.0),
                prismatic=Range("N", 50.0, 5e6, 8e3),
                positive=True,
                identity=float("inf"),
            ),
            Parameter(
                "length",
                "cable length at the source's zero",
                revolute=Range("m", -1.0, 5.0, 0.3),
                positive=False,
                ladder=Ladder(Per.VALUE, (0.0, 0.3)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("cable_stretch", "payload"),
        separating_runs=(Run.TWO_INSERTIONS, Run.LOAD_SWAP),
        sites=(Site.INSERTION,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.source, int) and self.source >= 1):
            raise DataError(f"effect {self.about.name}: source must be a joint's number, got {self.source!r}.")

    @property
    def joints(self) -> tuple[int, ...]:
        """The joint and the one that pays its cable out."""
        return (*super().joints, self.source)

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        k = self.column(motion.joints, self.source)
        length = np.maximum(self.length + motion.position[..., k], 0.0)
        return q[..., j] - motion.load[..., j] * length / self.rigidity
