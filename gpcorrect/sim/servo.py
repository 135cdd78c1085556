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
    """Run the loop over a reference, from a state that follows it in balance, with the torque and friction effects among `effects`.

    Raises
    ------
    DataError
        The gains make the sampled loop unstable.
    """
    _check_stable(drive, reference.inertia, clock.step)
    shape = reference.position.shape[1:]
    kp, kd = np.broadcast_to(drive.kp, shape).copy(), np.broadcast_to(drive.kd, shape).copy()
    gain = clock.step / np.broadcast_to(reference.inertia, shape)
    resistance = Resistance(of_kind(effects, FrictionEffect), joints, gain)
    torques = of_kind(effects, TorqueEffect)
    watched = bool(torques) or resistance.varies
    wanted = kp * reference.position + kd * reference.velocity + reference.feedforward
    load = np.ascontiguousarray(reference.load)

    position = reference.position[0] + (reference.feedforward[0] - load[0]) / drive.kp
    velocity = np.array(reference.velocity[0])
    torque, work, taken = (np.empty(shape) for _ in range(3))
    samples = np.empty((4, 1 + (len(wanted) - 1) // clock.stride, *shape))
    # The hot loop works in place: a dozen array operations a step, 20,000 steps for 20 s (style rule 16).
    for i in range(len(wanted)):
        np.multiply(kp, position, out=work)
        np.subtract(wanted[i], work, out=torque)
        np.multiply(kd, velocity, out=work)
        np.subtract(torque, work, out=torque)
        state = DriveState(joints, position, velocity, load[i]) if watched else None
        acting = torque
        for effect in torques:
            assert state is not None
            acting = effect.act(acting, state)
        np.subtract(acting, load[i], out=work)
        np.multiply(work, gain, out=work)
        slowing = resistance.at(state)
        is_sample = i % clock.stride == 0
        if is_sample:
            samples[:3, i // clock.stride] = position, velocity, torque
        np.add(velocity, work, out=velocity)
        np.multiply(velocity, slowing.factor, out=velocity)
        np.minimum(velocity, slowing.ceiling, out=taken)
        np.maximum(taken, slowing.floor, out=taken)
        np.subtract(velocity, taken, out=velocity)
        if is_sample:
            before = DriveState(joints, samples[0, i // clock.stride], samples[1, i // clock.stride], load[i])
            samples[3, i // clock.stride] = resistance.behind(before, velocity, taken)
        np.multiply(velocity, clock.step, out=work)
        np.add(position, work, out=position)
    return ServoPath(*samples)


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
