"""Backlash: a gap in the transmission that every reversal has to cross."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, play
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Backlash(JointEffect):
    """The joint follows the motor through a play."""

    radius: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="backlash",
        number=14,
        family=Family.REVERSAL,
        equation="q = play(m, radius): w = min(max(w_before, m - radius), m + radius)",
        source="Krasnosel'skii and Pokrovskii 1989, Systems with Hysteresis, Sec. 2",
        parameters=(
            Parameter(
                "radius",
                "half the gap",
                revolute=Range("rad", 0.0, 0.6, 0.01),
                prismatic=Range("m", 0.0, 0.02, 5e-4),
                positive=True,
                ladder=Ladder(Per.RANGE, (0.003, 0.01, 0.03, 0.1)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("coulomb_friction", "hysteresis"),
        separating_runs=(Run.AMPLITUDES, Run.LOAD_SWAP, Run.GAIN_CHANGE, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return play(q[..., j], self.radius, memory)
