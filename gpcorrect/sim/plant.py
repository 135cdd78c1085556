"""The whole machine, from desired joint path to true tool pose.

Feedback is on the motors, so that what lies behind them acts on the loop only through the load. The load depends on
where the arm is, and the arm's place a little on the load: the path is computed for the load of the path before,
starting from a quasi-static guess, until both agree (waveform relaxation). The load is computed
at the log's samples and interpolated between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.body import Body
from gpcorrect.sim.effects import Effect, PathEffect, Stage, TipEffect, of_kind
from gpcorrect.sim.loads import JointPath, LinkLoad, link_load, mean_inertia
from gpcorrect.sim.machine import Drive, Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.servo import Clock, Reference, ServoPath, follow
from gpcorrect.types import FloatArray

__all__ = ["PASSES", "Outcome", "joint_path", "run", "tip_path"]

PASSES = 2  # after the first guess; each shrinks an error of the load to a few per cent of it (load stiffness / kp)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the arm really did, n samples of N runs.

    Parameters
    ----------
    motion : Motion
        The motors, and what they carried.
    torque : (n, N, dof) array
        Commanded by the controllers, joint units.
    q : (n, N, dof) array
        True joint path, when outside sensors see it.
    T_base_tip : (n, N, 4, 4) array or None
        True tool poses; None for bare joints.
    """

    motion: Motion
    torque: FloatArray
    q: FloatArray
    T_base_tip: FloatArray | None


def run(machine: Machine, plan: Plan, passes: int = PASSES) -> Outcome:
    """Let the machine follow a plan.

    Parameters
    ----------
    machine : Machine
        Arm, drives and effects.
    plan : Plan
        Desired paths.
    passes : int
        Times that motion and load are computed from each other.

    Returns
    -------
    Outcome
    """
    body = machine.actual_body(plan)
    clock = Clock.of(machine.drive.rate_hz, plan.rate_hz)
    command = _Command.of(machine, plan, clock)
    mass = mean_inertia(body, plan.q)
    path = _first_guess(machine, plan, body, command)
    for _ in range(passes):
        load = link_load(body, path)
        reference = command.reference(load.total, mass * path.acceleration, machine.drive.motor_inertia + mass)
        servo = follow(machine.drive, reference, clock, body.joints, machine.effects)
        motion = _motion(body, plan, servo, load)
        q = joint_path(_mechanical(machine), motion)
        path = JointPath(q, servo.velocity, np.gradient(servo.velocity, 1.0 / plan.rate_hz, axis=0))
    seen = _through([e for e in machine.effects if e.stage == Stage.CLOCK], q, motion)
    return Outcome(motion, servo.torque, seen, tip_path(machine.effects, body.forward(seen), motion))


def _first_guess(machine: Machine, plan: Plan, body: Body, command: _Command) -> JointPath:
    """Path of motors that follow without delay and friction, pushed aside by the load that nothing feeds forward."""
    desired = command.desired
    load = command.nominal_load if machine.has_nominal_body else link_load(body, desired)
    fed = command.feedforward[:: command.clock.stride]
    unmet = load.total + machine.drive.motor_inertia * desired.acceleration - fed
    position = desired.q - unmet / machine.drive.kp
    servo = ServoPath(position, desired.velocity, unmet, np.zeros(position.shape))
    q = joint_path(_mechanical(machine), _motion(body, plan, servo, load))
    return JointPath(q, desired.velocity, desired.acceleration)


def joint_path(effects: Sequence[Effect], motion: Motion) -> FloatArray:
    """Return the true joint path `(n, N, dof)`: the reported motor path through every effect up to the link."""
    return _through(effects, motion.position, motion)


def tip_path(effects: Sequence[Effect], T_base_tip: FloatArray | None, motion: Motion) -> FloatArray | None:
    """Return the true tool poses `(n, N, 4, 4)`: the kinematics' poses through the effects at tool and base."""
    if T_base_tip is None:
        return None
    for effect in of_kind(effects, TipEffect):
        T_base_tip = effect.act(T_base_tip, motion)
    return T_base_tip


def _mechanical(machine: Machine) -> list[Effect]:
    """Return the effects without those of the clock: when the arm is seen changes no load."""
    return [effect for effect in machine.effects if effect.stage != Stage.CLOCK]


def _through(effects: Sequence[Effect], q: FloatArray, motion: Motion) -> FloatArray:
    for effect in of_kind(effects, PathEffect):
        q = effect.act(q, motion)
    return q


@dataclass(frozen=True, eq=False)
class _Command:
    """Desired motion at the log's samples, and at the servo's steps with the torque fed forward."""

    desired: JointPath
    nominal_load: LinkLoad
    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    clock: Clock

    @classmethod
    def of(cls, machine: Machine, plan: Plan, clock: Clock) -> _Command:
        spline = plan.spline()
        samples = np.arange(len(plan.q)) / plan.rate_hz
        steps = np.arange((len(plan.q) - 1) * clock.stride + 1) * clock.step
        desired = JointPath(plan.q, spline(samples, 1), spline(samples, 2))
        load = link_load(machine.nominal_body(plan), desired)
        feedforward = _interpolated(_feedforward(machine.drive, desired, load), clock.stride)
        return cls(desired, load, spline(steps), spline(steps, 1), feedforward, clock)

    def reference(self, carried: FloatArray, of_inertia: FloatArray, inertia: FloatArray) -> Reference:
        whole = _interpolated(carried, self.clock.stride)
        beyond = whole - _interpolated(of_inertia, self.clock.stride)
        return Reference(self.position, self.velocity, self.feedforward, beyond, inertia, whole)


def _feedforward(drive: Drive, desired: JointPath, nominal_load: LinkLoad) -> FloatArray:
    match drive.feedforward:
        case "none":
            return np.zeros(desired.q.shape)
        case "gravity":
            return nominal_load.gravity
        case "rigid-body":
            return nominal_load.total + drive.motor_inertia * desired.acceleration


def _motion(body: Body, plan: Plan, servo: ServoPath, load: LinkLoad) -> Motion:
    return Motion(
        joints=body.joints,
        time=plan.session_time,
        session=plan.session,
        position=servo.position,
        velocity=servo.velocity,
        load=load.total + servo.joint_friction,
        gravity_load=load.gravity,
        tip_force=body.tip_force,
    )


def _interpolated(samples: FloatArray, stride: int) -> FloatArray:
    """Values `((n - 1) stride + 1, ...)` on the servo's steps, linear between the `n` samples."""
    fraction = np.arange(stride).reshape(-1, *([1] * (samples.ndim - 1))) / stride
    between = samples[:-1, None] + fraction * (samples[1:] - samples[:-1])[:, None]
    return np.concatenate([between.reshape(-1, *samples.shape[1:]), samples[-1:]])
