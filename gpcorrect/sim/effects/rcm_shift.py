"""RCM shift: the remote centre of motion gives way sideways when the instrument is loaded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.effects.base import Stage, TipEffect, lateral_force
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

_STIFFNESS = Range("N/m", 20.0, 1e7, 3e3)


@dataclass(frozen=True)
class RcmShift(TipEffect):
    """The whole instrument moves across its shaft by the lateral force over a stiffness."""

    stiffness: float

    stage = Stage.BASE
    about = Description(
        name="rcm_shift",
        number=13,
        family=Family.COMPLIANCE,
        equation="d = F_lateral / stiffness, the same along the whole shaft",
        source="Hooke's law at the remote centre of motion",
        parameters=(
            Parameter(
                "stiffness",
                "lateral stiffness at the remote centre",
                revolute=_STIFFNESS,
                positive=True,
                identity=float("inf"),
            ),
        ),
        needs=("tracker_cp", "payload"),
        remote_centre=True,
        neighbours=("shaft_bending", "registration_error"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS),
        sites=(Site.BASE,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move the tip across the shaft, towards the force."""
        if np.isinf(self.stiffness):
            return T_base_tip
        force, _ = lateral_force(T_base_tip[..., :3, 3], motion.tip_force)
        return se3.pose(T_base_tip[..., :3, :3], T_base_tip[..., :3, 3] + force / self.stiffness)
