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
from gpcorrect.sim.command import Command, pushed_aside
from gpcorrect.sim.effects import Effect, PathEffect, Stage, TipEffect, of_kind
from gpcorrect.sim.loads import JointPath, LinkLoad, link_load, mean_inertia
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.servo import ServoPath, follow
from gpcorrect.types import FloatArray

__all__ = ["PASSES", "Driven", "Outcome", "follow_command", "joint_path", "run", "tip_path"]

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


@dataclass(frozen=True, eq=False)
class Driven:
    """Motion of the motors, what they carried and were told, and the links' true path before anyone looks.

    Parameters
    ----------
    motion : Motion
        Of the motors.
    torque, q : (n, N, dof) arrays
        Commanded torque; joint path behind every mechanical effect.
    """

    motion: Motion
    torque: FloatArray
    q: FloatArray


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
    driven = follow_command(machine, Command.of(machine, plan), passes)
    motion = driven.motion
    seen = _through([e for e in machine.effects if e.stage == Stage.CLOCK], driven.q, motion)
    tip = tip_path(machine.effects, machine.actual_body(plan).forward(seen), motion)
    return Outcome(motion, driven.torque, seen, tip)


def follow_command(machine: Machine, command: Command, passes: int = PASSES) -> Driven:
    """Let the motors follow a command, with the effects on the way from the drive to the link.

    Parameters
    ----------
    machine : Machine
        Arm, drives and effects.
    command : Command
        Made once for this arm, drive and plan; the effects may be others each time.
    passes : int
        As for :func:`run`.

    Returns
    -------
    Driven
    """
    plan, clock = command.plan, command.clock
    body = machine.actual_body(plan)
    mass = command.mass if machine.has_nominal_body else mean_inertia(body, plan.q)
    path, load = _first_guess(machine, body, command)
    for number in range(passes):
        load = link_load(body, path) if number or load is None else load
        reference = command.reference(load.total, mass * path.acceleration, machine.drive.motor_inertia + mass)
        servo = follow(machine.drive, reference, clock, body.joints, machine.effects)
        motion = _motion(body, plan, servo, load)
        q = joint_path(_mechanical(machine), motion)
        path = JointPath(q, servo.velocity, np.gradient(servo.velocity, 1.0 / plan.rate_hz, axis=0))
    return Driven(motion, servo.torque, q)


def _first_guess(machine: Machine, body: Body, command: Command) -> tuple[JointPath, LinkLoad | None]:
    """Path of motors that follow without delay and friction, pushed aside by the load that nothing feeds forward.

    With the load along it, where that is known already: effects in the drive do not change it.
    """
    if machine.has_nominal_body and not of_kind(_mechanical(machine), PathEffect):
        return command.guess, command.guess_load
    desired = command.desired
    load = command.nominal_load if machine.has_nominal_body else link_load(body, desired)
    position = pushed_aside(machine.drive, desired, load, command.feedforward)
    servo = ServoPath(position, desired.velocity, load.total, np.zeros(position.shape))
    q = joint_path(_mechanical(machine), _motion(body, command.plan, servo, load))
    return JointPath(q, desired.velocity, desired.acceleration), None


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
