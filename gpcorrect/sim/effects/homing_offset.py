"""Homing offset: the encoder's zero is not the joint's zero, and every homing sets a new one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class HomingOffset(JointEffect):
    """The robot reports the true position plus an offset."""

    offset: float | tuple[float, ...]

    stage = Stage.ENCODER
    about = Description(
        name="homing_offset",
        number=1,
        family=Family.GEOMETRY,
        equation="reported = q + offset, a new one each session",
        source="Hwang et al. 2020, IEEE RA-L 5(4), offset model",
        parameters=(
            Parameter(
                "offset",
                "reported minus true position",
                revolute=Range("rad", -0.35, 0.35, 0.05),
                prismatic=Range("m", -0.05, 0.05, 0.005),
                positive=False,
                per_session=True,
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("registration_error", "gravity_sag"),
        separating_runs=(Run.POSE_SPREAD, Run.REHOMING),
        sites=(Site.JOINT,),
    )

    def __post_init__(self) -> None:
        if isinstance(self.offset, list):
            object.__setattr__(self, "offset", tuple(self.offset))
        super().__post_init__()

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        offsets = np.atleast_1d(np.asarray(self.offset, dtype=np.float64))
        if len(offsets) > 1 and motion.session.max(initial=0) >= len(offsets):
            raise DataError(
                f"homing_offset of joint {self.joint} has {len(offsets)} offsets, the data have "
                f"{motion.session.max() + 1} sessions.",
                hint="Give one offset for all sessions, or one for each.",
            )
        return q[..., j] - (offsets[motion.session] if len(offsets) > 1 else offsets[0])
