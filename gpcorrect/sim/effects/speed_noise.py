"""Speed noise: an outside sensor reads at an unsure instant, so that its noise grows with the joint's speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.sim.effects.base import ReadingEffect, with_column
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion, Readings


@dataclass(frozen=True)
class SpeedNoise(ReadingEffect):
    """Further noise of zero mean on an outside joint sensor, as large as the joint moves in some time."""

    seconds: float

    about = Description(
        name="speed_noise",
        number=32,
        family=Family.NOISE,
        equation="y = x + seconds v e, v the joint's speed, e normal with unit variance",
        source="Shinagawa, Akazawa, Wakimoto 1990, IEEE J. Solid-State Circuits 25(1), jitter of the sampling instant",
        parameters=(
            Parameter(
                "seconds",
                "standard deviation of the instant at which the sensor reads",
                revolute=Range("s", 0.0, 1.0, 1e-3),
                positive=True,
            ),
        ),
        needs=("external_jp",),
        neighbours=("noise_change", "delay"),
        separating_runs=(Run.ONE_JOINT, Run.REFERENCE_RETURNS),
        sites=(Site.JOINT,),
    )

    def advance(self, readings: Readings, motion: Motion, rng: np.random.Generator, memory: Memory) -> Readings:
        """Return the readings with the noise."""
        j = self.column(motion.joints)
        speed = motion.velocity[..., j]
        noisy = readings.external_jp[..., j] + self.seconds * speed * rng.standard_normal(speed.shape)
        return replace(readings, external_jp=with_column(readings.external_jp, j, noisy))
