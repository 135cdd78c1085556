"""Payload: something hangs at the tip that the model does not know of."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gpcorrect.sim.body import Links
from gpcorrect.sim.effects.base import LoadEffect
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site

_MASS = Range("kg", 0.0, 3.0, 0.1)


@dataclass(frozen=True)
class Payload(LoadEffect):
    """A point mass at the tip, beyond the payload that is known; it weighs and it resists acceleration."""

    mass: float

    about = Description(
        name="payload",
        number=11,
        family=Family.COMPLIANCE,
        equation="tau = tau_0 + J^T mass (a - g)",
        source="Featherstone 2008, Rigid Body Dynamics Algorithms, Ch. 5",
        parameters=(Parameter("mass", "unknown mass at the tip", revolute=_MASS, positive=True),),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("gravity_sag", "length_dependent_stiffness"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS, Run.POSE_SPREAD),
        sites=(Site.ALL,),
    )

    def act(self, links: Links) -> Links:
        """Return the masses with more at the tip."""
        return replace(links, payload=links.payload + self.mass)
