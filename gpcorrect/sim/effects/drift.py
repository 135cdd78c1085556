"""Drift: the zero creeps away during a session as the machine warms up and its cables settle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Drift(JointEffect):
    """An offset that grows with session time: steadily, or towards a limit."""

    rate: float
    time_constant: float = float("inf")

    stage = Stage.ENCODER
    about = Description(
        name="drift",
        number=22,
        family=Family.TIME,
        equation="reported = q + rate T (1 - exp(-t / T)), T = time_constant; rate t as T grows",
        source="RAVEN-II calibration paper: shift over six hours of running; first-order warm-up law",
        parameters=(
            Parameter(
                "rate",
                "first rate of reported minus true position",
                revolute=Range("rad/s", -1e-3, 1e-3, 2e-6),
                prismatic=Range("m/s", -1e-4, 1e-4, 2e-7),
                positive=False,
            ),
            Parameter(
                "time_constant",
                "time over which it settles",
                revolute=Range("s", 10.0, float("inf"), 3600.0),
                positive=True,
                ladder=Ladder(Per.SESSION, (float("inf"), 0.5, 0.1)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("creep", "cable_slip"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.HOLD_UNLOAD),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        if np.isinf(self.time_constant):
            return q[..., j] - self.rate * motion.time
        return q[..., j] + self.rate * self.time_constant * np.expm1(-motion.time / self.time_constant)
