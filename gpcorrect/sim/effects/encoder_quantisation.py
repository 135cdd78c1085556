"""Encoder quantisation: the robot reads its motors in steps, and may miss some."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import ReadingEffect, with_column
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.types import FloatArray

_LOST = Range("1", 0.0, 0.5, 0.01)


@dataclass(frozen=True)
class EncoderQuantisation(ReadingEffect):
    """Reported positions are whole counts; each count is lost with some probability, so that the zero drifts.

    It acts on the recorded `measured_jp`, not on what the controller works with.
    """

    step: float
    lost: float = 0.0

    about = Description(
        name="encoder_quantisation",
        number=28,
        family=Family.NOISE,
        equation="reported = step round(q / step), each count lost with probability `lost`",
        source="Widrow and Kollar 2008, Quantization Noise, Ch. 1",
        parameters=(
            Parameter(
                "step",
                "size of one count at the joint",
                revolute=Range("rad", 0.0, 0.1, 1e-3),
                prismatic=Range("m", 0.0, 0.01, 1e-4),
                positive=True,
                ladder=Ladder(Per.PRIOR, (0.3, 1.0, 3.0)),
            ),
            Parameter("lost", "fraction of the counts that are missed", revolute=_LOST, positive=True),
        ),
        needs=("measured_jp", "setpoint_jp|external_jp|tracker_cp"),
        neighbours=("cable_slip", "noise_change"),
        separating_runs=(Run.ONE_JOINT, Run.REFERENCE_RETURNS),
        sites=(Site.JOINT,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lost > 1:
            raise DataError(f"effect encoder_quantisation: lost must be a fraction from 0 to 1, got {self.lost!r}.")

    def advance(self, readings: Readings, motion: Motion, rng: np.random.Generator, memory: Memory) -> Readings:
        """Return the readings with this joint's reported position in counts."""
        if self.step == 0:
            return readings
        j = self.column(motion.joints)
        counts = np.round(readings.measured_jp[..., j] / self.step)
        steps = np.diff(counts, axis=0, prepend=memory.get("counts", counts[:1]))
        missed = np.sign(steps) * rng.binomial(np.abs(steps).astype(np.int64), self.lost)
        total: FloatArray = memory.get("missed", np.zeros(1)) + missed.cumsum(axis=0)  # up ones less down ones
        memory["counts"], memory["missed"] = counts[-1:], total[-1:]
        return replace(readings, measured_jp=with_column(readings.measured_jp, j, self.step * (counts - total)))
