"""The machine live: commands come one after the other, and the arm is where its motors, cables and history left it.

`plant.run` knows a whole path before it starts and computes load and motion from each other. Here the future is
unknown: each step takes the load of the step before. At servo steps of a millisecond and blocks of a few, the
difference is far below what the machine's own effects do (`tests/sim/test_sim_live.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import PathEffect, Stage, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import tip_path
from gpcorrect.sim.servo import Clock, Loop, Reference
from gpcorrect.types import FloatArray

__all__ = ["LiveArm", "Moment"]

SETTLING = 4  # times that a start's load and place are computed from each other


@dataclass(frozen=True, eq=False)
class Moment:
    """Where the arm is at one instant.

    Parameters
    ----------
    time : float
        Seconds since the session began.
    motion : Motion
        The motors, and what they carry: one sample of one run.
    torque : (dof,) array
        Commanded by the controllers, joint units.
    q : (dof,) array
        True joints, when outside sensors see them.
    tool : callable
        Returns the true tool pose, base frame; None for bare joints.
    """

    time: float
    motion: Motion
    torque: FloatArray
    q: FloatArray
    tool: Callable[[], FloatArray | None]

    @cached_property
    def T_base_tip(self) -> FloatArray | None:  # noqa: N802 - a pose is named T
        """(4, 4) true tool pose; worked out when asked for."""
        return self.tool()

    @property
    def reported(self) -> FloatArray:
        """(dof,) joint positions that the motors report, before the encoders' steps."""
        position: FloatArray = self.motion.position[0, 0]
        return position


@dataclass(frozen=True, eq=False)
class _Bodies:
    actual: Body
    nominal: Body


class LiveArm:
    """A machine that is commanded as it goes; starts at rest, in balance, its slacks in the middle.

    Parameters
    ----------
    machine : Machine
        Arm, drives and effects; noise and faults of its sensors are not used here.
    q : (dof,) array
        Where it starts, rad or m.
    start : float
        Seconds since the session began.
    block : int
        Servo steps for which the load is taken as constant, and after which the effects behind the motors are brought
        up to date.
    """

    def __init__(self, machine: Machine, q: FloatArray, *, start: float = 0.0, block: int = 5) -> None:
        if len(q) != len(machine.body.joints):
            raise DataError(f"the machine has {len(machine.body.joints)} joints, got {len(q)}.")
        if block < 1:
            raise DataError(f"a block has at least one servo step, got {block}.")
        self.machine = machine
        self._bodies = _bodies(machine, None)
        self._loop = Loop(machine.drive, machine.body.joints, machine.effects)
        self._step = 1.0 / machine.drive.rate_hz
        self._block = block
        self._time = start
        self._position = np.array(q, dtype=np.float64)[None]
        self._velocity = np.zeros(self._position.shape)
        self._acceleration = np.zeros(self._position.shape)
        self._q = np.array(self._position)
        self._rate = np.zeros(self._position.shape)
        self._desired = np.array(self._position)
        for _ in range(SETTLING):
            self._settle()
        self._loop.check_stable(machine.drive.motor_inertia + self._load()[2], self._step)

    @property
    def step(self) -> float:
        """Seconds of one servo step."""
        return self._step

    def carry(self, payload: float | None) -> None:
        """Hang a known payload at the tip, kg; None is the machine's own."""
        self._bodies = _bodies(self.machine, payload)

    def advance(self, desired: FloatArray) -> Moment:
        """Follow desired joints `(m, dof)`, a row a servo step, and return where the arm is after them."""
        path = np.concatenate([self._desired, np.asarray(desired, dtype=np.float64)])
        for first in range(0, len(desired), self._block):
            self._advance_block(path[first : first + self._block + 1])
        return self.moment

    def _settle(self) -> None:
        """Let the motors stand where their controllers and the load balance, and forget the past."""
        still = np.zeros(self._desired.shape)
        balance = self._fed(self._desired, still, still) - self._load()[0]
        self._position = self._desired + balance / self.machine.drive.kp
        effects = of_kind(self.machine.effects, PathEffect)
        self._mechanical = [e.operator() for e in effects if e.stage != Stage.CLOCK]
        self._clock = [e.operator() for e in effects if e.stage == Stage.CLOCK]
        self.moment = self._look(still, still)

    def _advance_block(self, path: FloatArray) -> None:
        """Follow `(m + 1, dof)` desired joints, the first of which was followed already."""
        rate = np.diff(path, axis=0) / self._step
        gravity, inertial, mass = self._loads
        inertia = self.machine.drive.motor_inertia + mass
        beyond = gravity + inertial - mass * self._acceleration[0]
        fed = self._fed(path[-1:], rate[-1:], self._change(rate))
        m = len(rate)
        flat = np.ones((m, 1, 1))
        reference = Reference(
            path[None, 1:], rate[None], fed * flat, beyond * flat, inertia, (gravity + inertial) * flat
        )
        before = self._velocity
        self._position, self._velocity = self._position.copy(), self._velocity.copy()
        servo = self._loop.run(reference, Clock(self._step, 1), self._position, self._velocity)
        self._acceleration = (self._velocity - before) / (m * self._step)
        self._desired, self._time = path[-1:], self._time + m * self._step
        self.moment = self._look(servo.torque[-1], servo.joint_friction[-1])

    def _load(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return loads of weight and of inertia, and the links' inertias, `(dof,)` each, as the arm is now."""
        posture = posture_at(self._bodies.actual, self._q)
        if posture is None:
            none = np.zeros(self._q.shape[-1])
            return none, none, none
        gravity, inertial = posture.loads(self._velocity, self._acceleration)
        return gravity[0], inertial[0], posture.inertia_diagonal()[0]

    def _change(self, rate: FloatArray) -> FloatArray:
        """Desired acceleration `(1, dof)` over a block."""
        before, self._rate = self._rate, rate[-1:]
        change: FloatArray = (rate[-1:] - before) / (len(rate) * self._step)
        return change

    def _fed(self, desired: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Torque `(1, dof)` that the controller feeds forward."""
        drive = self.machine.drive
        posture = None if drive.feedforward == "none" else posture_at(self._bodies.nominal, desired)
        if posture is None:
            return np.zeros(desired.shape)
        if drive.feedforward == "gravity":
            return posture.gravity_load()
        gravity, inertial = posture.loads(rate, acceleration)
        return gravity + inertial + drive.motor_inertia * acceleration

    def _look(self, torque: FloatArray, joint_friction: FloatArray) -> Moment:
        """Bring what lies behind the motors up to date."""
        body = self._bodies.actual
        self._loads = self._load()
        gravity, inertial, _ = self._loads
        motion = Motion(
            joints=body.joints,
            time=np.full((1, 1), self._time),
            session=np.zeros(1, dtype=np.int64),
            position=self._position[None],
            velocity=self._velocity[None],
            load=(gravity + inertial + joint_friction)[None],
            gravity_load=gravity[None, None],
            tip_force=body.tip_force,
        )
        q = self._position[None]
        for effect in self._mechanical:
            q = effect(q, motion)
        self._q = q[0]
        for effect in self._clock:
            q = effect(q, motion)
        return Moment(self._time, motion, torque[0], q[0, 0], partial(_tool, self.machine, body, q, motion))


def _tool(machine: Machine, body: Body, q: FloatArray, motion: Motion) -> FloatArray | None:
    """Tool pose `(4, 4)` of one sample."""
    T = tip_path(machine.effects, body.forward(q), motion)
    return None if T is None else T[0, 0]


def _bodies(machine: Machine, payload: float | None) -> _Bodies:
    """Return the real and the nominal body with a payload."""
    still = np.zeros((4, 1, len(machine.body.joints)))
    plan = Plan(
        rate_hz=machine.log_rate_hz,
        q=still,
        trajectory=np.zeros((4, 1), dtype=np.int64),
        session=np.zeros(1, dtype=np.int64),
        start=np.zeros(1),
        payload=np.array([np.nan if payload is None else payload]),
    )
    return _Bodies(machine.actual_body(plan), machine.nominal_body(plan))
