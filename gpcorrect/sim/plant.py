"""The whole machine, from desired joint path to true tool pose.

Feedback is on the motors, so that what lies behind them acts on the loop only through the load. The load depends on
where the arm is, and the arm's place a little on the load: the path is computed for the load of the path before,
starting from a quasi-static guess, until both agree (waveform relaxation). The load is computed
at the log's samples and interpolated between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gpcorrect.sim.body import Body, Drive
from gpcorrect.sim.dynamics import JointPath, LinkLoad, link_load, mean_inertia
from gpcorrect.sim.effect_paths import joint_path, load_on_motors, through, tip_path
from gpcorrect.sim.effects import Effect, PathEffect, Stage, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.servo import Clock, Reference, ServoPath, follow
from gpcorrect.types import FloatArray

PASSES, MOST_PASSES = 2, 12
"""After the first guess: each shrinks an error of the load to a few per cent of it (load stiffness / kp), where motors
have most of the inertia. Where links have, and turn one another, it halves it: there are more until one changes next to
nothing (`SETTLED`). An iiwa without rotors, its errors of 2.4 to 3.8 mrad: 2 passes leave 12 to 61 urad, 8 leave 1 to
10."""
SETTLED = 2e-3
"""Of how far a joint is from where it should be, root mean square; chosen by hand. On that iiwa half of it takes 12
passes in place of 11, and double 8; residuals of a recording by PyBullet differ by 0.4 urad at most."""
PASSES_BEYOND = 1  # after a run that differs by little, for what that changes of the load
LAGGING_PASSES = 3  # where `kv` lets the motors lag behind: on a UR5e 5e-7 rad from the limit (2 passes: 2e-5)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the arm really did, n samples of N runs.

    Parameters
    ----------
    motion : Motion, the motors, and what they carried
    torque : (n, N, dof) array, commanded by the controllers, joint units
    q : (n, N, dof) array, true joint path, when outside encoders see it
    T_base_tip : (n, N, 4, 4) array or None, true tool poses, when the tracker sees them; None for bare joints
    """

    motion: Motion
    torque: FloatArray
    q: FloatArray
    T_base_tip: FloatArray | None


@dataclass(frozen=True, eq=False)
class Driven:
    """What the motors did and carried, and the links' true path before any sensor's delay.

    Parameters
    ----------
    motion : Motion
    torque, q : (n, N, dof) arrays, commanded torque; joint path behind every mechanical effect
    passes : int, in which load and path were computed from each other
    """

    motion: Motion
    torque: FloatArray
    q: FloatArray
    passes: int = 0

    @property
    def nbytes(self) -> int:
        """Bytes of what the loop made."""
        made = self.motion
        arrays = (self.torque, self.q, made.position, made.velocity, made.load, made.gravity_load)
        return sum(array.nbytes for array in arrays)


def run(machine: Machine, plan: Plan, passes: int | None = None) -> Outcome:
    """Let the machine follow a plan.

    Parameters
    ----------
    machine : Machine
        Arm, drives and effects.
    plan : Plan
        Desired paths.
    passes : int, optional
        Times that motion and load are computed from each other; as many as they need when None.
    """
    driven = follow_command(machine, Command.of(machine, plan), passes)
    motion = driven.motion
    clock = [e for e in of_kind(machine.effects, PathEffect) if e.stage == Stage.CLOCK]
    seen, tracked = (through([e for e in clock if e.is_seen_by(tracker=t)], driven.q, motion) for t in (False, True))
    tip = tip_path(machine.effects, machine.actual_body(machine.payload(plan)).forward(tracked), motion)
    return Outcome(motion, driven.torque, seen, tip)


def follow_command(machine: Machine, command: Command, passes: int | None = None) -> Driven:
    """Let the motors follow a command, with the effects on the way from the drive to the link.

    Parameters
    ----------
    machine : Machine
    command : Command, made once for this arm, drive and plan; the effects may be others each time
    passes : int, optional, as for :func:`run`
    """
    plan, clock = command.plan, command.clock
    body, drive = machine.actual_body(machine.payload(plan)), machine.actual_drive
    if (late := drive.latency) is not machine.drive.latency:
        command = replace(Command.of(machine, plan, late), begun=command.begun, passes=command.passes)
    believed, known, fed = machine.believed_body(machine.payload(plan)), command.nominal_load, command.feedforward
    if believed is not None:
        known = link_load(believed, command.desired)
    if believed is not None or drive is not machine.drive:
        fed = feedforward(drive, command.desired, known)
    mass = command.mass
    if not machine.has_nominal_body:
        mass = mean_inertia(body, plan.q)
    path, load = _first_guess(machine, body, command, drive, fed)
    motors = path.q if command.begun is None else command.begun.motion.position
    fewest, most = PASSES if drive.kv is None else LAGGING_PASSES, MOST_PASSES
    if command.begun is not None:
        fewest = most = command.passes or max(fewest, command.begun.passes // 2)
    if passes is not None:
        fewest = most = passes
    for number in range(most):
        load = link_load(body, path) if number or load is None else load
        felt = load_on_motors(machine.effects, load.total, body.joints)
        beyond_inertia = felt - mass * path.acceleration
        inertia = drive.motor_inertia + mass
        given = fed
        if drive.is_compensated:
            again = command.begun is not None and not number and believed is None
            moved = command.begun_gravity if again else _moved_gravity(believed or command.body, known, motors)
            given = fed + drive.delivered * moved
        reference = Reference(command.position, command.velocity, given, beyond_inertia, inertia, felt)
        servo = follow(drive, reference, clock, body.joints, machine.effects, plan.begins)
        changed, motors = servo.position - motors, servo.position
        motion = _motion(body, plan, servo, load)
        q = joint_path(mechanical(machine), motion)
        path = _path(plan, q, servo.velocity)
        away = motors - command.desired.q
        if number + 1 >= fewest and ((changed**2).mean((0, 1)) <= SETTLED**2 * (away**2).mean((0, 1))).all():
            break
    return Driven(motion, servo.torque, q, number + 1)


def _moved_gravity(body: Body, load: LinkLoad, motors: FloatArray) -> FloatArray:
    """Torque `(n, N, dof)` by which what holds an arm differs where the motors are from where they should."""
    still = np.zeros(motors.shape)
    return link_load(body, JointPath(motors, still, still)).gravity - load.gravity


def _first_guess(
    machine: Machine, body: Body, command: Command, drive: Drive, fed: FloatArray
) -> tuple[JointPath, LinkLoad | None]:
    """Path of motors that follow without delay and friction, pushed aside by the load that nothing feeds forward.

    With the load along it, where that is known already: effects in the drive do not change it.
    """
    if command.begun is not None:
        return command.guess, command.guess_load if machine.has_nominal_body else None
    if machine.has_nominal_body and fed is command.feedforward and not of_kind(mechanical(machine), PathEffect):
        return command.guess, command.guess_load
    desired = command.desired
    load = command.nominal_load if machine.has_nominal_body else link_load(body, desired)
    position = _pushed_aside(drive, desired, load, fed)
    servo = ServoPath(position, desired.velocity, load.total, np.zeros(position.shape))
    q = joint_path(mechanical(machine), _motion(body, command.plan, servo, load))
    return JointPath(q, desired.velocity, desired.acceleration), None


def mechanical(machine: Machine) -> list[Effect]:
    """Return the effects without those of the clock: when the arm is seen changes no load.

    Parameters
    ----------
    machine : Machine
    """
    return [effect for effect in machine.effects if effect.stage != Stage.CLOCK]


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


@dataclass(frozen=True, eq=False)
class Command:
    """A plan on one arm and drive.

    Parameters
    ----------
    plan : Plan
    body, drive : Body and Drive, as the controller knows them
    clock : Clock
    desired : JointPath, desired motion at the log's samples
    position, velocity : (N, m, dof) arrays, the same at the loop's m steps
    nominal_load : LinkLoad, of the nominal arm along the desired path
    feedforward : (n, N, dof) array, torque that the controller adds, at the log's samples
    mass : (dof,) array, mean inertia of the nominal links at each joint
    begun : Driven or None
        A run of it, with other effects, to begin with in place of a guess. As many passes are taken from there whatever
        the effects, so that what they do is smooth in their numbers.
    passes : int or None
        How many; where None half of those that the run took, and as many as from a guess at least. `PASSES_BEYOND`,
        one, is enough to say what a difference in effects changes, to the few per cent of that by which it changes its
        own load.
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
    begun: Driven | None = None
    passes: int | None = None

    @classmethod
    def of(cls, machine: Machine, plan: Plan, latency: FloatArray | None = None) -> Command:
        """Compute it for the arm and the drive of a machine.

        Parameters
        ----------
        machine : Machine, arm and drive; its effects do not count
        plan : Plan
        latency : (dof,) array, optional
            Seconds that it is late, not at all by default; before a run begins it goes on as it begins.
        """
        late = np.zeros(len(machine.body.joints)) if latency is None else latency
        clock, spline = Clock.of(machine.drive.rate_hz, plan.rate_hz), plan.spline()
        body = machine.nominal_body(machine.payload(plan))
        samples = np.arange(len(plan.q), dtype=np.float64) / plan.rate_hz
        steps = np.arange((len(plan.q) - 1) * clock.stride + 1) * clock.step
        q, rate, acceleration = (_late(spline, samples, late, order) for order in range(3))
        desired = JointPath(q, rate, acceleration)
        load = link_load(body, desired)
        fed = feedforward(machine.drive, desired, load)
        position, velocity = (
            np.ascontiguousarray(_late(spline, steps, late, order).swapaxes(0, 1)) for order in (0, 1)
        )
        mass = mean_inertia(body, plan.q)
        return cls(plan, body, machine.drive, clock, desired, position, velocity, load, fed, mass)

    @cached_property
    def guess(self) -> JointPath:
        """Where the nominal arm would be without delay and friction, or where it has been."""
        if self.begun is not None:
            return _path(self.plan, self.begun.q, self.begun.motion.velocity)
        aside = _pushed_aside(self.drive, self.desired, self.nominal_load, self.feedforward)
        return JointPath(aside, self.desired.velocity, self.desired.acceleration)

    @cached_property
    def guess_load(self) -> LinkLoad:
        """Load of the nominal arm there."""
        return link_load(self.body, self.guess)

    @cached_property
    def begun_gravity(self) -> FloatArray:
        """What :func:`_moved_gravity` is where the motors have been."""
        assert self.begun is not None
        return _moved_gravity(self.body, self.nominal_load, self.begun.motion.position)


def _path(plan: Plan, q: FloatArray, velocity: FloatArray) -> JointPath:
    return JointPath(q, velocity, np.gradient(velocity, 1.0 / plan.rate_hz, axis=0))


def _late(spline: CubicSpline, time: NDArray[np.floating], latency: FloatArray, order: int) -> FloatArray:
    """Return a derivative of paths `(n, N, dof)`, of each joint at an earlier time; beyond either end it goes on."""
    first, *others = np.unique(latency)
    value = _before(spline, time - first, order)
    for late in others:
        value[..., latency == late] = _before(spline, time - late, order)[..., latency == late]
    return value


def _before(spline: CubicSpline, time: NDArray[np.floating], order: int) -> FloatArray:
    inside = np.clip(time, spline.x[0], spline.x[-1])
    beyond = (time - inside)[:, None, None]
    value: FloatArray = spline(inside, order)
    if order == 1 or not beyond.any():
        return value
    return np.asarray(np.where(beyond == 0, value, 0.0) if order else value + beyond * spline(inside, 1))


def _pushed_aside(drive: Drive, desired: JointPath, load: LinkLoad, feedforward: FloatArray) -> FloatArray:
    """Motor path `(n, N, dof)` without delay and friction: the controller yields to what nothing feeds forward."""
    return desired.q - (load.total + drive.motor_inertia * desired.acceleration - feedforward) / drive.kp


def feedforward(drive: Drive, desired: JointPath, nominal_load: LinkLoad) -> FloatArray:
    """Return the torque `(n, N, dof)` that the motors deliver for what the controller feeds forward.

    Parameters
    ----------
    drive : Drive
    desired : JointPath
    nominal_load : LinkLoad, of the nominal arm along it
    """
    gravity, inertia, velocity = drive.beyond
    gravity = gravity + (drive.feedforward != "none")
    inertia = inertia + (drive.feedforward == "rigid-body")
    motors = drive.motor_inertia if drive.known_inertia is None else drive.known_inertia
    of_inertia = nominal_load.total - nominal_load.gravity + motors * desired.acceleration
    asked: FloatArray = gravity * nominal_load.gravity + inertia * of_inertia
    fed: FloatArray = drive.delivered * asked + velocity * drive.kd * desired.velocity
    return fed
