"""The servo loop: a PD controller on each motor against inertia, load and friction, step by step.

Runs and joints advance together. Dry friction is set-valued (Moreau's time stepping): a step first moves freely, then
friction takes away what speed it can and no more, so that a joint really sticks and no threshold speed is needed
(Acary and Brogliato 2008, Numerical Methods for Nonsmooth Dynamical Systems, Ch. 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect, FrictionEffect, TorqueEffect, of_kind
from gpcorrect.sim.machine import Drive
from gpcorrect.sim.motion import DriveState
from gpcorrect.sim.resistance import Resistance
from gpcorrect.types import FloatArray

__all__ = ["Clock", "Reference", "ServoPath", "follow"]


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
    """What the loop is given at each of its m steps, `(m, N, dof)` arrays.

    Parameters
    ----------
    position, velocity : arrays
        Desired motor motion, joint units.
    feedforward : array
        Torque added to the controller's.
    load : array
        Torque that the links ask of the motor, beyond `inertia` times its acceleration.
    inertia : (dof,) array
        Motor and mean link inertia that the loop accelerates, kg m^2 or kg.
    """

    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    load: FloatArray
    inertia: FloatArray


class ServoPath(NamedTuple):
    """Motor motion at the log's samples, `(n, N, dof)` each.

    `torque` is what the controller commands, `joint_friction` the friction that acts behind the transmission.
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    joint_friction: FloatArray


def follow(
    drive: Drive, reference: Reference, clock: Clock, joints: tuple[int, ...], effects: Sequence[Effect]
) -> ServoPath:
    """Run the loop over a reference, from a state that follows it in balance, with the effects that act in the loop.

    Raises
    ------
    DataError
        The gains make the sampled loop unstable.
    """
    _check_stable(drive, reference.inertia, clock.step)
    gain = clock.step / np.broadcast_to(reference.inertia, reference.position.shape[1:])
    wanted = drive.kp * reference.position + drive.kd * reference.velocity + reference.feedforward
    loop = _Loop(
        thrust=gain * (wanted - reference.load),
        spring=gain * drive.kp,
        damper=gain * drive.kd,
        gain=gain,
        load=reference.load,
        resistance=Resistance(of_kind(effects, FrictionEffect), joints, gain),
        torques=of_kind(effects, TorqueEffect),
        joints=joints,
    )
    balance = (reference.feedforward[0] - reference.load[0]) / drive.kp
    return loop.advance(reference.position[0] + balance, np.array(reference.velocity[0]), clock)


@dataclass(frozen=True, eq=False)
class _Loop:
    """The loop's constants, torques turned into the speed that they give in one step (`gain` times them)."""

    thrust: FloatArray
    spring: FloatArray
    damper: FloatArray
    gain: FloatArray
    load: FloatArray
    resistance: Resistance
    torques: tuple[TorqueEffect, ...]
    joints: tuple[int, ...]

    def advance(self, position: FloatArray, velocity: FloatArray, clock: Clock) -> ServoPath:
        """Step through the reference. The hot loop: in place, a dozen array operations a step (style rule 16)."""
        spring, damper, resistance = self.spring, self.damper, self.resistance
        watched = bool(self.torques) or resistance.varies
        push, work, taken = np.empty(velocity.shape), np.empty(velocity.shape), np.zeros(velocity.shape)
        samples = np.empty((4, 1 + (len(self.thrust) - 1) // clock.stride, *velocity.shape))
        for i in range(len(self.thrust)):
            np.multiply(spring, position, out=work)
            np.subtract(self.thrust[i], work, out=push)
            np.multiply(damper, velocity, out=work)
            np.subtract(push, work, out=push)
            state = DriveState(self.joints, position, velocity, self.load[i]) if watched else None
            k, past_sample = divmod(i, clock.stride)
            if not past_sample:
                samples[:3, k] = position, velocity, push / self.gain + self.load[i]
            if state is not None and self.torques:
                push = self._altered(push, state)
            np.add(velocity, push, out=velocity)
            if resistance.present:
                slowing = resistance.at(state)
                np.multiply(velocity, slowing.factor, out=velocity)
                np.minimum(velocity, slowing.ceiling, out=taken)
                np.maximum(taken, slowing.floor, out=taken)
                np.subtract(velocity, taken, out=velocity)
            if not past_sample:
                before = DriveState(self.joints, samples[0, k], samples[1, k], self.load[i])
                samples[3, k] = resistance.behind(before, velocity, taken)
            np.multiply(velocity, clock.step, out=work)
            np.add(position, work, out=position)
        return ServoPath(*samples)

    def _altered(self, push: FloatArray, state: DriveState) -> FloatArray:
        """Push `(N, dof)` once the torque effects have changed the commanded torque."""
        torque = push / self.gain + state.load
        for effect in self.torques:
            torque = effect.act(torque, state)
        altered: FloatArray = self.gain * (torque - state.load)
        return altered


def _check_stable(drive: Drive, inertia: FloatArray, step: float) -> None:
    """Eigenvalues of one joint's sampled loop, without load and friction, must not leave the unit circle."""
    for j, (kp, kd, mass) in enumerate(zip(drive.kp, drive.kd, inertia, strict=True)):
        speed = np.array([-step * kp / mass, 1.0 - step * kd / mass])
        loop = np.array([[1.0, 0.0] + step * speed, speed])
        if np.abs(np.linalg.eigvals(loop)).max() > 1.0 + 1e-9:
            raise DataError(
                f"the controller of column {j + 1} is unstable at a step of {step:.3g} s: kp {kp:.4g}, kd {kd:.4g}, "
                f"inertia {mass:.4g}.",
                hint="Lower kp and kd, or raise motor_inertia or rate_hz.",
            )
