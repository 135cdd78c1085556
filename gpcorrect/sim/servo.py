"""The servo loop: a PD controller on each motor against inertia, load and friction, step by step.

Dry friction is set-valued (Moreau's time stepping): a step first moves freely, then friction takes away what speed it
can and no more, so that a joint really sticks and no threshold speed is needed (Acary and Brogliato 2008, Numerical
Methods for Nonsmooth Dynamical Systems, Ch. 10). Effects of the catalogue act by their laws, in the compiled steps;
any other is asked before each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect, FrictionEffect, LawfulFriction, LawfulTorque, TorqueEffect, of_kind
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw
from gpcorrect.sim.effects.stages import SIDES
from gpcorrect.sim.machine import Drive
from gpcorrect.sim.motion import DriveState
from gpcorrect.sim.servo_steps import Given, Laws, Outside, advance, no_outside
from gpcorrect.sim.threads import in_parts
from gpcorrect.types import FloatArray

__all__ = ["Clock", "Loop", "Reference", "ServoPath", "follow"]


@dataclass(frozen=True)
class Clock:
    """Servo steps of `step` seconds, of which every `stride`-th is a log sample."""

    step: float
    stride: int

    @classmethod
    def of(cls, rate_hz: float, log_rate_hz: float) -> Clock:
        """Run the loop at `rate_hz`, or as little faster as makes its steps meet the log's samples."""
        stride = max(1, int(np.ceil(rate_hz / log_rate_hz - 1e-9)))
        return cls(step=1.0 / (log_rate_hz * stride), stride=stride)


@dataclass(frozen=True, eq=False)
class Reference:
    """What the loop is given.

    Parameters
    ----------
    position, velocity : (N, m, dof) arrays
        Desired motor motion at each of the loop's m steps, joint units; runs first, as the loop reads them.
    feedforward : (n, N, dof) array
        Torque added to the controller's, at the log's samples; linear between them, as the two loads are.
    load : (n, N, dof) array
        Torque that the links ask of the motor, beyond `inertia` times its acceleration.
    inertia : (dof,) array
        Motor and mean link inertia that the loop accelerates, kg m^2 or kg.
    carried : (n, N, dof) array or None
        Torque that the links ask of the joint altogether, on which friction may depend; `load` when None.
    """

    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    load: FloatArray
    inertia: FloatArray
    carried: FloatArray | None = None


class ServoPath(NamedTuple):
    """Motor motion at the log's samples, `(n, N, dof)` each.

    `torque` is what the controller commands, `joint_friction` the friction and the stops that act behind the
    transmission.
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    joint_friction: FloatArray


class Loop:
    """The servo loop of one machine, over one reference after the other.

    Parameters
    ----------
    drive : Drive
        Gains and feedforward.
    joints : tuple of int
        Joint numbers of the columns.
    effects : sequence of Effect
        Of the machine; those that act in the loop are used.
    """

    def __init__(self, drive: Drive, joints: tuple[int, ...], effects: Sequence[Effect]) -> None:
        self._drive = drive
        self._laws, self._lawless = _laws(effects, joints), _Lawless.of(effects, joints)

    def check_stable(self, inertia: FloatArray, step: float) -> None:
        """Refuse gains that cannot hold joints of that inertia `(dof,)` at that step, s.

        Raises
        ------
        DataError
            The gains, or a stop's stiffness, make the sampled loop unstable.
        """
        _check_stable(self._drive, _stops(self._laws, len(inertia)), inertia, step)

    def run(self, reference: Reference, clock: Clock, position: FloatArray, velocity: FloatArray) -> ServoPath:
        """Go over a reference from a state `(N, dof)`, which is moved on in place."""
        given, laws, lawless = _given(self._drive, reference, clock), self._laws, self._lawless
        runs, steps = given.position.shape[:2]
        samples = np.empty((4, *given.load.shape))
        outside = no_outside(*velocity.shape)
        if not lawless.effects:

            def move(first: int, last: int) -> None:
                advance((first, last), (0, steps), given, laws, outside, position, velocity, samples)

            in_parts(runs, given.position.size, move)
        else:
            for i in range(steps):
                lawless.ask(given, i, position, velocity, outside)
                advance((0, runs), (i, i + 1), given, laws, outside, position, velocity, samples)
        return ServoPath(*np.ascontiguousarray(samples.swapaxes(1, 2)))


def follow(
    drive: Drive, reference: Reference, clock: Clock, joints: tuple[int, ...], effects: Sequence[Effect]
) -> ServoPath:
    """Run the loop over a reference, from a state that follows it in balance, with the effects that act in the loop.

    Raises
    ------
    DataError
        The gains, or a stop's stiffness, make the sampled loop unstable.
    """
    loop = Loop(drive, joints, effects)
    loop.check_stable(reference.inertia, clock.step)
    balance = (reference.feedforward[0] - reference.load[0]) / drive.kp
    return loop.run(reference, clock, reference.position[:, 0] + balance, np.array(reference.velocity[:, 0]))


def _given(drive: Drive, reference: Reference, clock: Clock) -> Given:
    gain = clock.step / reference.inertia
    kp, kd, gain = (np.asarray(a, dtype=np.float64) for a in (drive.kp, drive.kd, gain))
    carried = reference.load if reference.carried is None else reference.carried
    position, velocity = (np.ascontiguousarray(p) for p in (reference.position, reference.velocity))
    sampled = (reference.feedforward, reference.load, carried)
    feedforward, load, carried = (np.ascontiguousarray(p.swapaxes(0, 1)) for p in sampled)
    return Given(kp, kd, gain, clock.step, clock.stride, position, velocity, feedforward, load, carried)


def _laws(effects: Sequence[Effect], joints: tuple[int, ...]) -> Laws:
    """Laws of the catalogue's effects as arrays."""
    frictions = sorted(of_kind(effects, LawfulFriction), key=lambda e: e.column(joints))
    torques = sorted(of_kind(effects, LawfulTorque), key=lambda e: e.column(joints))
    columns = np.arange(len(joints) + 1)
    return Laws(
        friction=np.array([e.law() for e in frictions]).reshape(-1, len(FrictionLaw._fields)),
        friction_of=np.searchsorted([e.column(joints) for e in frictions], columns),
        friction_side=np.array([SIDES.index(e.side) for e in frictions], dtype=np.int64),
        torque=np.array([e.law() for e in torques]).reshape(-1, len(TorqueLaw._fields)),
        torque_of=np.searchsorted([e.column(joints) for e in torques], columns),
    )


@dataclass(frozen=True, eq=False)
class _Lawless:
    """Effects that have a method instead of a law: asked before each step, which is much slower."""

    torques: tuple[TorqueEffect, ...]
    frictions: tuple[FrictionEffect, ...]
    joints: tuple[int, ...]

    @classmethod
    def of(cls, effects: Sequence[Effect], joints: tuple[int, ...]) -> _Lawless:
        torques = tuple(e for e in of_kind(effects, TorqueEffect) if not isinstance(e, LawfulTorque))
        frictions = tuple(e for e in of_kind(effects, FrictionEffect) if not isinstance(e, LawfulFriction))
        return cls(torques, frictions, joints)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All of them."""
        return (*self.torques, *self.frictions)

    def ask(self, given: Given, i: int, position: FloatArray, velocity: FloatArray, outside: Outside) -> None:
        """Put what the effects do in step i into `outside`."""
        state = DriveState(self.joints, position.copy(), velocity.copy(), _at_step(given.carried, i, given.stride))
        commanded = given.kp * (given.position[:, i] - position) + given.kd * (given.velocity[:, i] - velocity)
        commanded += _at_step(given.feedforward, i, given.stride)
        torque = commanded
        for effect in self.torques:
            torque = effect.act(torque, state)
        outside.torque[:] = torque - commanded
        for array in (outside.forward, outside.backward, outside.damping):
            array.fill(0.0)
        for friction in self.frictions:
            where = SIDES.index(friction.side), slice(None), friction.column(self.joints)
            limit, damping, backward = friction.act(state)
            outside.forward[where] += limit
            outside.backward[where] += limit if backward is None else backward
            outside.damping[where] += damping


def _at_step(samples: FloatArray, i: int, stride: int) -> FloatArray:
    """Values `(N, dof)` at a step, linear between samples `(N, n, dof)`."""
    k, part = divmod(i, stride)
    here, after = samples[:, k], samples[:, min(k + 1, samples.shape[1] - 1)]
    return here + part / stride * (after - here)


def _stops(laws: Laws, dof: int) -> FloatArray:
    """Stiffness `(dof,)` of the stops of each joint together."""
    stiffness, column = np.zeros(dof), np.repeat(np.arange(dof), np.diff(laws.torque_of))
    np.add.at(stiffness, column, laws.torque[:, TorqueLaw._fields.index("stiffness")])
    return stiffness


def _check_stable(drive: Drive, stops: FloatArray, inertia: FloatArray, step: float) -> None:
    """Eigenvalues of one joint's sampled loop, without load and friction, must not leave the unit circle."""
    for j, (kp, kd, mass) in enumerate(zip(drive.kp + stops, drive.kd, inertia, strict=True)):
        speed = np.array([-step * kp / mass, 1.0 - step * kd / mass])
        loop = np.array([[1.0, 0.0] + step * speed, speed])
        if np.abs(np.linalg.eigvals(loop)).max() > 1.0 + 1e-9:
            raise DataError(
                f"the controller of column {j + 1} is unstable at a step of {step:.3g} s: kp (with the joint's stops) "
                f"{kp:.4g}, kd {kd:.4g}, inertia {mass:.4g}.",
                hint="Lower kp, kd or the stops' stiffness, or raise motor_inertia or rate_hz.",
            )
