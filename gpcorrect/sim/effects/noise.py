"""Effects on readings: counts of encoders, and noise of outside sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gpcorrect.sim.effects.base import ReadingEffect, with_column
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.types import FloatArray

# Units, physical ranges and typical sizes on revolute and prismatic joints.
STEP = Range("rad", 0.0, 0.1, 1e-3), Range("m", 0.0, 0.01, 1e-4)
STD = Range("rad", 0.0, 0.1, 1e-3), Range("m", 0.0, 0.01, 2e-4)


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
            Parameter("step", "size of one count at the joint", *STEP, ladder=Ladder(Per.PRIOR, (0.3, 1.0, 3.0))),
            Parameter("lost", "fraction of the counts that are missed", Range("1", 0.0, 0.5, 0.01), at_most=1.0),
        ),
        needs=("measured_jp", "setpoint_jp|external_jp|tracker_cp"),
        neighbours=("cable_slip", "noise_change"),
        separating_runs=(Run.ONE_JOINT, Run.REFERENCE_RETURNS),
    )

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


@dataclass(frozen=True)
class NoiseChange(ReadingEffect):
    """Further noise of zero mean on an outside joint sensor, or ("tool") on each axis of the tracked position."""

    std: float
    tail: float = inf  # normal
    since: float = 0.0

    about = Description(
        name="noise_change",
        number=29,
        family=Family.NOISE,
        equation="y = x + std e [t >= since], e Student with `tail` degrees of freedom and unit variance",
        source="Lange, Little, Taylor 1989, J. Am. Stat. Assoc. 84(408), Student errors",
        parameters=(
            Parameter("std", "standard deviation of the further noise", *STD),
            Parameter(
                "tail",
                "degrees of freedom",
                Range("1", 2.0, inf, 8.0),
                above=2.0,
                ladder=Ladder(Per.VALUE, (inf, 3.0)),
            ),
            Parameter(
                "since",
                "session time from which on it acts",
                Range("s", 0.0, 1e6, 600.0),
                ladder=Ladder(Per.SESSION, (0.0, 0.5)),
            ),
        ),
        needs=("external_jp|tracker_cp",),
        neighbours=("encoder_quantisation", "hysteresis"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.ONE_JOINT),
        sites=(Site.JOINT, Site.TOOL),
    )

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


@dataclass(frozen=True)
class SpeedNoise(ReadingEffect):
    """An outside joint sensor reads at an unsure instant: noise of zero mean, as large as the joint moves meanwhile."""

    seconds: float

    about = Description(
        name="speed_noise",
        number=32,
        family=Family.NOISE,
        equation="y = x + seconds v e, v the joint's speed, e normal with unit variance",
        source="Shinagawa, Akazawa, Wakimoto 1990, IEEE J. Solid-State Circuits 25(1), jitter of the sampling instant",
        parameters=(
            Parameter(
                "seconds", "standard deviation of the instant at which the sensor reads", Range("s", 0.0, 1.0, 1e-3)
            ),
        ),
        needs=("external_jp",),
        neighbours=("noise_change", "delay"),
        separating_runs=(Run.ONE_JOINT, Run.REFERENCE_RETURNS),
    )

    def advance(self, readings: Readings, motion: Motion, rng: np.random.Generator, memory: Memory) -> Readings:
        """Return the readings with the noise."""
        j = self.column(motion.joints)
        speed = motion.velocity[..., j]
        noisy = readings.external_jp[..., j] + self.seconds * speed * rng.standard_normal(speed.shape)
        return replace(readings, external_jp=with_column(readings.external_jp, j, noisy))
