"""What a plan asks of an arm and its controller, whatever effects there are: computed once for many runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpcorrect.sim.body import Body
from gpcorrect.sim.loads import JointPath, LinkLoad, link_load, mean_inertia
from gpcorrect.sim.machine import Drive, Machine
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.servo import Clock, Reference
from gpcorrect.types import FloatArray

__all__ = ["Command", "pushed_aside"]


@dataclass(frozen=True, eq=False)
class Command:
    """A plan on one arm and drive.

    Parameters
    ----------
    plan : Plan
        Desired paths.
    body, drive : Body, Drive
        As the controller knows them.
    clock : Clock
        Of the servo loop.
    desired : JointPath
        Desired motion at the log's samples.
    position, velocity : (N, m, dof) arrays
        The same at the loop's m steps.
    nominal_load : LinkLoad
        Of the nominal arm along the desired path.
    feedforward : (n, N, dof) array
        Torque that the controller adds, at the log's samples.
    mass : (dof,) array
        Mean inertia of the nominal links at each joint.
    """

    plan: Plan
    body: Body
    drive: Drive
    clock: Clock
    desired: JointPath
    position: FloatArray
    velocity: FloatArray
    nominal_load: LinkLoad
    feedforward: FloatArray
    mass: FloatArray

    @classmethod
    def of(cls, machine: Machine, plan: Plan) -> Command:
        """Compute it for the arm and the drive of a machine; its effects do not count."""
        clock, spline, body = Clock.of(machine.drive.rate_hz, plan.rate_hz), plan.spline(), machine.nominal_body(plan)
        samples = np.arange(len(plan.q)) / plan.rate_hz
        steps = np.arange((len(plan.q) - 1) * clock.stride + 1) * clock.step
        desired = JointPath(plan.q, spline(samples, 1), spline(samples, 2))
        load = link_load(body, desired)
        fed = _feedforward(machine.drive, desired, load)
        position, velocity = (np.ascontiguousarray(spline(steps, order).swapaxes(0, 1)) for order in (0, 1))
        mass = mean_inertia(body, plan.q)
        return cls(plan, body, machine.drive, clock, desired, position, velocity, load, fed, mass)

    @cached_property
    def guess(self) -> JointPath:
        """Where the nominal arm would be without delay and friction."""
        aside = pushed_aside(self.drive, self.desired, self.nominal_load, self.feedforward)
        return JointPath(aside, self.desired.velocity, self.desired.acceleration)

    @cached_property
    def guess_load(self) -> LinkLoad:
        """Load of the nominal arm there."""
        return link_load(self.body, self.guess)

    def reference(self, carried: FloatArray, of_inertia: FloatArray, inertia: FloatArray) -> Reference:
        """Return what the loop is given, for a load along the path and what of it the loop's inertia makes up."""
        return Reference(self.position, self.velocity, self.feedforward, carried - of_inertia, inertia, carried)


def pushed_aside(drive: Drive, desired: JointPath, load: LinkLoad, feedforward: FloatArray) -> FloatArray:
    """Motor path `(n, N, dof)` without delay and friction: the controller yields to what nothing feeds forward."""
    position: FloatArray = (
        desired.q - (load.total + drive.motor_inertia * desired.acceleration - feedforward) / drive.kp
    )
    return position


def _feedforward(drive: Drive, desired: JointPath, nominal_load: LinkLoad) -> FloatArray:
    match drive.feedforward:
        case "none":
            return np.zeros(desired.q.shape)
        case "gravity":
            return nominal_load.gravity
        case "rigid-body":
            return nominal_load.total + drive.motor_inertia * desired.acceleration
