"""Nonlinear stretch: a cable that stiffens as it is pulled, its strands bedding in first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class NonlinearStretch(JointEffect):
    """The joint lags behind the motor by the stretch d of a hardening spring."""

    stiffness: float
    cubic: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="nonlinear_stretch",
        number=8,
        family=Family.COMPLIANCE,
        equation="q = m - d, tau = stiffness d + cubic d^3",
        source="Spong 1987, J. Dyn. Syst. Meas. Control 109(4), elastic joints; Duffing's cubic spring",
        parameters=(
            Parameter(
                "stiffness",
                "stiffness at small loads",
                revolute=Range("N m/rad", 2.0, 1e5, 200.0),
                prismatic=Range("N/m", 100.0, 1e7, 2e4),
                positive=True,
                identity=float("inf"),
            ),
            Parameter(
                "cubic",
                "hardening",
                revolute=Range("N m/rad^3", 0.0, 1e14, 2e8),
                prismatic=Range("N/m^3", 0.0, 1e18, 2e12),
                positive=True,
                ladder=Ladder(
                    Per.PRIOR, (0.001, 0.03, 1.0, 30.0)
                ),  # as stiff as the linear part at a milliradian, 0.1 mm
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("cable_stretch", "backlash"),
        separating_runs=(Run.LOAD_SWAP, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - self._stretch(motion.load[..., j])

    def _stretch(self, torque: FloatArray) -> FloatArray:
        """Stretch at torques of any shape: the real root of the cubic, by hyperbolic functions."""
        if np.isinf(self.stiffness) or self.cubic == 0:
            return torque / self.stiffness
        if self.stiffness == 0:
            return np.cbrt(torque / self.cubic)
        knee = np.sqrt(self.stiffness / (3.0 * self.cubic))
        root: FloatArray = 2.0 * knee * np.sinh(np.arcsinh(1.5 * torque / (self.stiffness * knee)) / 3.0)
        return root
