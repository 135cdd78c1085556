"""DH error: a link is not as long, twisted or placed as the kinematic table says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from gpcorrect.arms import Chain, Joint
from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import ChainEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.types import FloatArray

_LENGTH, _ANGLE = Range("m", -0.05, 0.05, 1e-3), Range("rad", -0.2, 0.2, 5e-3)
_length = partial(Parameter, revolute=_LENGTH, positive=False)
_angle = partial(Parameter, revolute=_ANGLE, positive=False)


@dataclass(frozen=True)
class DhError(ChainEffect):
    """Small errors of one row of the Denavit-Hartenberg table, or of the tool: a further row behind the last link."""

    a: float
    alpha: float
    d: float
    theta: float

    about = Description(
        name="dh_error",
        number=6,
        family=Family.GEOMETRY,
        equation="true row = nominal row + (a, alpha, d, theta)",
        source="Mooring, Roth, Driels 1991, Fundamentals of Manipulator Calibration, Ch. 2",
        parameters=(
            _length("a", "true minus nominal link length"),
            _angle("alpha", "true minus nominal twist"),
            _length("d", "true minus nominal offset along the joint's axis"),
            _angle("theta", "true minus nominal angle about the joint's axis"),
        ),
        needs=("tracker_cp",),
        neighbours=("registration_error", "homing_offset", "gravity_sag"),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.JOINT, Site.TOOL),
    )

    def act(self, chain: Chain) -> Chain:
        """Return the chain with the altered row or tool."""
        if self.joint == "tool":
            return replace(chain, tool=self._extra_row(chain) @ chain.tool)
        assert isinstance(self.joint, int)
        if self.joint > chain.dof:
            raise DataError(f"effect dh_error acts on joint {self.joint}, the arm has {chain.dof}.")
        rows = list(chain.joints)
        row = rows[self.joint - 1]
        rows[self.joint - 1] = replace(
            row, a=row.a + self.a, alpha=row.alpha + self.alpha, d=row.d + self.d, theta=row.theta + self.theta
        )
        return replace(chain, joints=tuple(rows))

    def _extra_row(self, chain: Chain) -> FloatArray:
        row = Joint("R", self.alpha, self.a, self.d, self.theta, -1.0, 1.0)
        return Chain((row,), chain.convention).forward([0.0])
