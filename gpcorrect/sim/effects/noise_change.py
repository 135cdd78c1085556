"""Noise change: an outside sensor is noisier than the model says, or has heavier tails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import ReadingEffect, with_column
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class NoiseChange(ReadingEffect):
    """Further noise of zero mean on an outside joint sensor, or ("tool") on each axis of the tracked position."""

    std: float
    tail: float = float("inf")  # normal
    since: float = 0.0

    about = Description(
        name="noise_change",
        number=29,
        family=Family.NOISE,
        equation="y = x + std e [t >= since], e Student with `tail` degrees of freedom and unit variance",
        source="Lange, Little, Taylor 1989, J. Am. Stat. Assoc. 84(408), Student errors",
        parameters=(
            Parameter(
                "std",
                "standard deviation of the further noise",
                revolute=Range("rad", 0.0, 0.1, 1e-3),
                prismatic=Range("m", 0.0, 0.01, 2e-4),
                positive=True,
            ),
            Parameter(
                "tail",
                "degrees of freedom",
                revolute=Range("1", 2.0, float("inf"), 8.0),
                positive=True,
                factor=2.0,
                ladder=Ladder(Per.VALUE, (float("inf"), 3.0)),
            ),
            Parameter(
                "since",
                "session time from which on it acts",
                revolute=Range("s", 0.0, 1e6, 600.0),
                positive=True,
                ladder=Ladder(Per.SESSION, (0.0, 0.5)),
            ),
        ),
        needs=("external_jp|tracker_cp",),
        neighbours=("encoder_quantisation", "hysteresis"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.ONE_JOINT),
        sites=(Site.JOINT, Site.TOOL),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.tail > 2:
            raise DataError(f"effect noise_change: tail must be above 2 (infinite is normal), got {self.tail!r}.")

    def advance(self, readings: Readings, motion: Motion, rng: np.random.Generator, memory: Memory) -> Readings:
        """Return the readings with the noise."""
        if self.joint != "tool":
            j = self.column(motion.joints)
            noisy = readings.external_jp[..., j] + self._noise(motion.time, rng)
            return replace(readings, external_jp=with_column(readings.external_jp, j, noisy))
        if readings.T_tracker_marker is None:
            return readings
        poses = np.array(readings.T_tracker_marker)
        poses[..., :3, 3] += np.stack([self._noise(motion.time, rng) for _ in range(3)], axis=-1)
        return replace(readings, T_tracker_marker=poses)

    def _noise(self, time: FloatArray, rng: np.random.Generator) -> FloatArray:
        if np.isinf(self.tail):
            draw = rng.standard_normal(time.shape)
        else:
            draw = rng.standard_t(self.tail, time.shape) * np.sqrt((self.tail - 2.0) / self.tail)
        return np.where(time >= self.since, self.std * draw, 0.0)
