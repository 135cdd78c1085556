"""Registration error: the tracker's frame is not where, nor as large as, the registration says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.effects.base import Stage, TipEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

_SHIFT, _TURN, _SCALE = Range("m", -0.1, 0.1, 5e-3), Range("rad", -0.35, 0.35, 0.02), Range("1", -0.1, 0.1, 5e-3)
_shift = partial(Parameter, revolute=_SHIFT, positive=False)
_turn = partial(Parameter, revolute=_TURN, positive=False)


@dataclass(frozen=True)
class RegistrationError(TipEffect):
    """Poses are seen through a similarity y = s R q + t, about the base origin and in base axes.

    Where the tracker is registered from the same data, that registration takes all of it but the scale.
    """

    x: float
    y: float
    z: float
    rx: float
    ry: float
    rz: float
    scale: float

    stage = Stage.BASE
    about = Description(
        name="registration_error",
        number=5,
        family=Family.GEOMETRY,
        equation="y = (1 + scale) R p + t, t = (x, y, z), R of the rotation vector (rx, ry, rz)",
        source="Umeyama 1991, IEEE Trans. PAMI 13(4): similarity between two sets of points",
        parameters=(
            _shift("x", "shift along the base's x axis"),
            _shift("y", "shift along the base's y axis"),
            _shift("z", "shift along the base's z axis"),
            _turn("rx", "rotation vector, x"),
            _turn("ry", "rotation vector, y"),
            _turn("rz", "rotation vector, z"),
            Parameter("scale", "relative error of lengths", revolute=_SCALE, positive=False),
        ),
        needs=("tracker_cp",),
        neighbours=("dh_error", "homing_offset"),
        separating_runs=(Run.POSE_SPREAD,),
        sites=(Site.BASE,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move the poses by the similarity."""
        R = se3.matrix_from_rotvec(np.array([self.rx, self.ry, self.rz]))
        position = (1.0 + self.scale) * T_base_tip[..., :3, 3] @ R.T + np.array([self.x, self.y, self.z])
        return se3.pose(R @ T_base_tip[..., :3, :3], position)
