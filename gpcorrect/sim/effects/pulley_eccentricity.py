"""Pulley eccentricity: a pulley that does not run true adds a wave of its turns to the transmission."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class PulleyEccentricity(JointEffect):
    """The reported position swings around the true one as the pulley turns."""

    amplitude: float
    waves: float
    phase: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="pulley_eccentricity",
        number=4,
        family=Family.GEOMETRY,
        equation="reported = q + amplitude sin(waves reported + phase)",
        source="first harmonic of a pulley whose axis is off its centre; the phase is counted on the motor's side",
        parameters=(
            Parameter(
                "amplitude",
                "size of the wave, reported minus true position",
                revolute=Range("rad", -0.1, 0.1, 0.003),
                prismatic=Range("m", -0.01, 0.01, 2e-4),
                positive=False,
            ),
            Parameter(
                "waves",
                "phase of the pulley for each unit of the joint",
                revolute=Range("1", 1.0, 60.0, 10.0),  # the joint's own pulley turns slowest
                prismatic=Range("rad/m", 1.0, 500.0, 150.0),
                positive=True,
                factor=2.0,
                # Half a wave apart: none is missed. Three quarters of a wave at least, or any bend would be one.
                ladder=Ladder(Per.SWEEP, tuple(np.pi * k for k in range(2, 15)), within=(1.5 * np.pi, 1e9)),
            ),
            Parameter(
                "phase",
                "phase at zero",
                revolute=Range("rad", -2 * np.pi, 2 * np.pi, 1.0),  # twice round: no wall where it may want to pass
                positive=False,
                ladder=Ladder(Per.VALUE, (0.0, np.pi / 2)),
                period=2 * np.pi,
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("position_dependent_friction", "transmission_ratio"),
        separating_runs=(Run.AMPLITUDES, Run.ONE_JOINT),
        sites=(Site.JOINT,),
    )

    def canonical(self) -> PulleyEccentricity:
        """Return the same wave with a positive amplitude and a phase within half a turn."""
        phase = self.phase + (np.pi if self.amplitude < 0 else 0.0)
        return replace(self, amplitude=abs(self.amplitude), phase=float(np.angle(np.exp(1j * phase))))

    def overtones(self) -> tuple[PulleyEccentricity, ...]:
        """Return waves of two, three and four times its frequency.

        A wheel off its centre has none; encoders that interpolate badly, and gears, do.
        """
        return tuple(
            replace(self, waves=k * self.waves, phase=k * self.phase + shift)
            for k in (2, 3, 4)
            for shift in (0.0, np.pi / 2)
        )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - self.amplitude * np.sin(self.waves * q[..., j] + self.phase)
