"""Shaft bending: the instrument's shaft bends under what hangs at the tip, and no joint encoder sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.effects.base import Stage, TipEffect, lateral_force
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

_RIGIDITY = Range("N m^2", 0.05, 1e4, 10.0)


@dataclass(frozen=True)
class ShaftBending(TipEffect):
    """A cantilever from the remote centre of motion to the tip, loaded at its end."""

    rigidity: float

    stage = Stage.TIP
    about = Description(
        name="shaft_bending",
        number=12,
        family=Family.COMPLIANCE,
        equation="d = F L^3 / (3 rigidity) across the shaft, turned by F L^2 / (2 rigidity)",
        source="Euler-Bernoulli cantilever; Roark's Formulas for Stress and Strain, Table 8.1",
        parameters=(
            Parameter(
                "rigidity",
                "bending stiffness EI of the shaft",
                revolute=_RIGIDITY,
                positive=True,
                identity=float("inf"),
            ),
        ),
        needs=("tracker_cp", "payload"),
        remote_centre=True,
        neighbours=("cable_stretch", "rcm_shift"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS),
        sites=(Site.TOOL,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move and turn the tip across the shaft, towards the force."""
        if np.isinf(self.rigidity):
            return T_base_tip
        tip = T_base_tip[..., :3, 3]
        force, length = lateral_force(tip, motion.tip_force)
        axis = np.cross(tip / np.maximum(length, 1e-12), force)
        R = se3.matrix_from_rotvec(axis * length**2 / (2.0 * self.rigidity))
        return se3.pose(R @ T_base_tip[..., :3, :3], tip + force * length**3 / (3.0 * self.rigidity))
