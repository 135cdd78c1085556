"""The machine that is simulated: body, drives, sensors' noise and effects, resolved to arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.arms import Arm
from gpcorrect.sim.body import Body, Drive
from gpcorrect.sim.effects import ChainEffect, DriveEffect, Effect, LoadEffect, in_order, of_kind
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.settings import Noise, TrackerFaults
from gpcorrect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Machine:
    """An arm with its drives, effects and sensors.

    Parameters
    ----------
    arm : str, name of the arm, for the log
    body : Body, nominal geometry and masses
    drive : Drive
    log_rate_hz : float
    effects : tuple of Effect, where it differs from the nominal machine; put in the order in which they act
    noise : Noise
    faults : TrackerFaults, what goes wrong with the tracker now and then
    T_tracker_base, T_tip_marker : (4, 4) arrays
        Base in the tracker's frame, and tracked marker in the tip frame.
    description : Arm or None, the arm's own numbers: limits, rest position, speeds; None for bare joints
    """

    arm: str
    body: Body
    drive: Drive
    log_rate_hz: float = 100.0
    effects: tuple[Effect, ...] = ()
    noise: Noise = field(default_factory=Noise)
    faults: TrackerFaults = field(default_factory=TrackerFaults)
    T_tracker_base: FloatArray = field(default_factory=lambda: np.eye(4))
    T_tip_marker: FloatArray = field(default_factory=lambda: np.eye(4))
    description: Arm | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", in_order(self.effects))
        for effect in self.effects:
            for number in effect.joints:
                effect.column(self.body.joints, number)

    def with_effects(self, *effects: Effect) -> Machine:
        """Return the machine with these effects instead of its own."""
        return replace(self, effects=effects)

    def payload(self, plan: Plan) -> FloatArray:
        """Payload `(N,)` in each run: the plan's, or the model's own where the plan says none.

        Parameters
        ----------
        plan : Plan
        """
        return np.where(np.isnan(plan.payload), self.body.links.payload, plan.payload)

    def nominal_body(self, payload: FloatArray) -> Body:
        """Body as the controller knows it, with the known payloads.

        Parameters
        ----------
        payload : (N,) array, kg at the tip in each run
        """
        return replace(self.body, links=replace(self.body.links, payload=payload)).compact()

    def believed_body(self, payload: FloatArray) -> Body | None:
        """Body that the controller computes with, where effects make it another than the nominal one.

        Parameters
        ----------
        payload : (N,) array, kg at the tip in each run
        """
        believed = [load for load in of_kind(self.effects, LoadEffect) if load.believed]
        body = replace(self.body, links=replace(self.body.links, payload=payload))
        for load in believed:
            body = load.act(body)
        return body.compact() if believed else None

    def actual_body(self, payload: FloatArray) -> Body:
        """Body as it really is: with the effects on masses, gravity and geometry.

        Parameters
        ----------
        payload : (N,) array, kg at the tip in each run
        """
        body = replace(self.body, links=replace(self.body.links, payload=payload))
        for load in of_kind(self.effects, LoadEffect):
            body = body if load.believed else load.act(body)
        if (chain := body.chain) is not None:
            changes = of_kind(self.effects, ChainEffect)
            for change in changes:
                change.check(chain)
            for change in changes:
                chain = change.act(chain)
        return replace(body, chain=chain).compact()

    @property
    def actual_drive(self) -> Drive:
        """Controller as it really is."""
        drive = self.drive
        for effect in of_kind(self.effects, DriveEffect):
            drive = effect.act(drive, self.body.joints)
        return drive

    @property
    def has_nominal_body(self) -> bool:
        """Whether no effect touches masses, gravity or geometry."""
        loads = of_kind(self.effects, LoadEffect)
        return not of_kind(self.effects, ChainEffect) and all(load.believed for load in loads)
