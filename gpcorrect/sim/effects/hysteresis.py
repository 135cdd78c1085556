"""Hysteresis: after each reversal a little of the motion is lost again, along a curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.bouc_wen import bouc_wen
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, plays
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

LAWS = ("bouc_wen", "plays")
PLAYS = 8  # in the sum: with twice as many the path changes by less than a hundredth of the radius


@dataclass(frozen=True)
class Hysteresis(JointEffect):
    """The joint lags behind the motor by the state of an element with memory."""

    radius: float
    sharpness: float = 1.0  # a long soft curve; a large one is a play with a corner
    depth: float = 1.0
    law: str = "bouc_wen"  # that element with beta = gamma; "plays": a Prandtl-Ishlinskii sum of plays

    stage = Stage.TRANSMISSION
    about = Description(
        name="hysteresis",
        number=20,
        family=Family.REVERSAL,
        equation="q = m - z, dz = depth (1 - |z / radius|^sharpness (1 + sign(z dm)) / 2) dm; "
        "or q = (1 - depth) m + depth mean of play(m, r_i / depth), r_i mean radius",
        source="Bouc 1967; Wen 1976; Ismail, Ikhouane, Rodellar 2009, Arch. Comput. Methods Eng. 16; "
        "Brokate and Sprekels 1996, Hysteresis and Phase Transitions, Sec. 2.4",
        parameters=(
            Parameter(
                "radius",
                "largest lag",
                revolute=Range("rad", 0.0, 0.6, 0.01),
                prismatic=Range("m", 0.0, 0.02, 5e-4),
                positive=True,
                ladder=Ladder(Per.RANGE, (0.01, 0.03, 0.1)),
            ),
            Parameter(
                "sharpness",
                "exponent of the curve",
                revolute=Range("1", 0.3, 20.0, 1.5),
                positive=True,
                factor=2.0,
                ladder=Ladder(Per.VALUE, (1.0, 3.0)),
            ),
            Parameter(
                "depth",
                "share of a motion that is lost right after a reversal",
                revolute=Range("1", 0.02, 1.0, 0.25),
                positive=True,
                factor=2.0,
                ladder=Ladder(Per.VALUE, (0.25,), absent=True),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("backlash", "coulomb_friction"),
        separating_runs=(Run.AMPLITUDES, Run.LOAD_SWAP, Run.GAIN_CHANGE),
        sites=(Site.JOINT,),
        choices=(("law", LAWS),),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sharpness > 0:
            raise DataError(f"effect hysteresis: sharpness must be > 0, got {self.sharpness!r}.")
        if not 0 < self.depth <= 1:
            raise DataError(f"effect hysteresis: depth must be above 0 and at most 1, got {self.depth!r}.")

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        m, width = q[..., j], self.radius / self.depth
        if self.law == "bouc_wen":
            return m - self.depth * bouc_wen(m, width, self.sharpness, memory)
        spread = ((np.arange(PLAYS) + 0.5) / PLAYS) ** (1.0 / self.sharpness)
        return m - self.depth * (m - plays(m, width * spread / spread.mean(), memory))
