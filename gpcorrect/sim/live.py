"""The machine live: commands come one after the other, and the arm is where its motors, cables and history left it.

`plant.run` knows a whole path before it starts and computes load and motion from each other. Here the future is
unknown: each step takes the load of the step before. At servo steps of a millisecond and blocks of a few, the
difference is far below what the machine's own effects do (`tests/sim/test_sim_live.py`). The servo loop, the effects
and the sensors are the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.sim.dynamics import JointPath, LinkLoad, link_load, mean_inertia
from gpcorrect.sim.effect_paths import load_on_motors, tip_path
from gpcorrect.sim.effects import PathEffect, Stage, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plant import feedforward
from gpcorrect.sim.servo import Clock, Loop, Reference
from gpcorrect.types import FloatArray

SETTLING = 4  # times that a start's load and place follow from each other; an error shrinks to a few per cent each


@dataclass(frozen=True, eq=False)
class Moment:
    """Where the arm is at one instant.

    Parameters
    ----------
    machine, body : Machine and Body, the machine, and its body as it really is
    motion : Motion, the motors, and what they carry: one sample of one run
    torque : (1, 1, dof) array, commanded by the controllers, joint units
    q, q_tracked : (1, 1, dof) arrays, true joints, when outside encoders and the tracker see them
    """

    machine: Machine
    body: Body
    motion: Motion
    torque: FloatArray
    q: FloatArray
    q_tracked: FloatArray

    @property
    def time(self) -> float:
        """Seconds since the session began."""
        return float(self.motion.time[0, 0])

    @cached_property
    def tip(self) -> FloatArray | None:
        """(1, 1, 4, 4) true tool pose, base frame, computed when asked for; None for bare joints."""
        return tip_path(self.machine.effects, self.body.forward(self.q_tracked), self.motion)

    @property
    def T_base_tip(self) -> FloatArray | None:  # noqa: N802 - a pose is named T
        """(4, 4) the same."""
        return None if self.tip is None else self.tip[0, 0]


class LiveArm:
    """A machine that is commanded as it goes; starts at rest, in balance, its slacks in the middle.

    Parameters
    ----------
    machine : Machine, arm, drives and effects; noise and faults of its sensors are not used here
    q : (dof,) array, where it starts, rad or m
    start : float, seconds since the session began
    block : int
        Servo steps for which the load is taken as constant, and after which the effects behind the motors are brought
        up to date.

    Raises
    ------
    DataError
        The loop is unstable, or an effect asks for the future.
    """

    def __init__(self, machine: Machine, q: FloatArray, *, start: float = 0.0, block: int = 5) -> None:
        self.machine = machine
        self.step = 1.0 / machine.drive.rate_hz  # s
        payload = machine.body.links.payload
        self._actual = machine.actual_body(payload)
        self._nominal = machine.believed_body(payload) or machine.nominal_body(payload)
        self._drive = machine.actual_drive
        self._loop = Loop(self._drive, machine.body.joints, machine.effects)
        self._block, self._time = block, start
        # Desired, motors' and joints' positions and rates, (1, 1, dof) each.
        self._desired = np.array(q, dtype=np.float64)[None, None]
        still = np.zeros(self._desired.shape)
        self._position, self._q = self._desired, self._desired
        self._rate, self._velocity, self._acceleration = still, still, still
        late = np.zeros(self._desired.shape[-1]) if self._drive.latency is None else self._drive.latency
        if (late < 0).any():
            raise DataError(
                f"an arm that runs live cannot follow what is commanded {-late.min()} s later.",
                hint="Leave the effect `command_delay` out, or give it a delay of at least 0.",
            )
        self._steps_late = late / self.step
        self._sent = np.repeat(self._desired[0], int(np.ceil(self._steps_late.max())) + 1, axis=0)
        for _ in range(SETTLING):
            self._settle()
        self._loop.check_stable(self._drive.motor_inertia + self._mass, self.step)

    def advance(self, desired: FloatArray) -> Moment:
        """Follow desired joints and return where the arm is after them.

        Parameters
        ----------
        desired : (m, dof) array, a row a servo step, rad or m
        """
        path = np.concatenate([self._desired[0], self._late(np.asarray(desired, dtype=np.float64))])
        for first in range(0, len(desired), self._block):
            self._advance_block(path[first : first + self._block + 1])
        return self.moment

    def _late(self, desired: FloatArray) -> FloatArray:
        """Return what reaches the controllers `(m, dof)` while these joints are sent."""
        if not self._steps_late.any():
            return desired
        sent = np.concatenate([self._sent, desired])
        at = np.arange(len(self._sent), len(sent))[:, None] - self._steps_late
        whole = np.minimum(np.floor(at).astype(np.int64), len(sent) - 2)
        part, column = at - whole, np.arange(sent.shape[1])
        self._sent = sent[len(sent) - len(self._sent) :]
        return np.asarray((1.0 - part) * sent[whole, column] + part * sent[whole + 1, column])

    def _settle(self) -> None:
        """Let the motors stand where their controllers and the load balance, and forget the past."""
        still = np.zeros(self._desired.shape)
        torque = self._fed(JointPath(self._desired, still, still)) - self._felt(self._load())
        self._state = self._loop.balanced(self._desired[0], torque[0], still[0])
        self._position = self._state.position.copy()[None]
        effects = of_kind(self.machine.effects, PathEffect)
        self._mechanical = [e.operator() for e in effects if e.stage != Stage.CLOCK]
        clock = [e for e in effects if e.stage == Stage.CLOCK]
        self._clocks = [[e.operator() for e in clock if e.is_seen_by(tracker=t)] for t in (False, True)]
        self.moment = self._look(still, still)

    def _advance_block(self, path: FloatArray) -> None:
        """Follow `(m + 1, dof)` desired joints, the first of which was followed already."""
        rate, m = np.diff(path, axis=0) / self.step, len(path) - 1
        flat = np.ones((m, 1, 1))
        last, carried = rate[None, -1:], self._felt(self._carried)
        fed = self._fed(JointPath(path[None, -1:], last, (last - self._rate) / (m * self.step)))
        beyond = carried - self._mass * self._acceleration
        inertia = self._drive.motor_inertia + self._mass
        reference = Reference(path[None, 1:], rate[None], fed * flat, beyond * flat, inertia, carried * flat)
        servo = self._loop.run(reference, Clock(self.step, 1), self._state)
        velocity = self._state.velocity.copy()[None]
        self._acceleration = (velocity - self._velocity) / (m * self.step)
        self._position, self._velocity = self._state.position.copy()[None], velocity
        self._desired, self._rate, self._time = path[None, -1:], last, self._time + m * self.step
        self.moment = self._look(servo.torque[-1:], servo.joint_friction[-1:])

    def _load(self) -> LinkLoad:
        """Return what the links ask of the joints as the arm is now."""
        return link_load(self._actual, JointPath(self._q, self._velocity, self._acceleration))

    def _felt(self, load: LinkLoad) -> FloatArray:
        """Return what the motors feel of it."""
        return load_on_motors(self.machine.effects, load.total, self._actual.joints)

    def _fed(self, desired: JointPath) -> FloatArray:
        """Torque `(1, 1, dof)` that the controller feeds forward."""
        if not self._drive.feeds:
            return np.zeros(desired.q.shape)
        load = link_load(self._nominal, desired)
        fed = feedforward(self._drive, desired, load)
        if not self._drive.is_compensated:
            return fed
        there = link_load(self._nominal, replace(desired, q=self._position))
        return fed + self._drive.delivered * (there.gravity - load.gravity)

    def _look(self, torque: FloatArray, joint_friction: FloatArray) -> Moment:
        """Bring what lies behind the motors up to date."""
        self._carried, self._mass = self._load(), mean_inertia(self._actual, self._q)
        motion = Motion(
            joints=self._actual.joints,
            time=np.full((1, 1), self._time),
            session=np.zeros(1, dtype=np.int64),
            position=self._position,
            velocity=self._velocity,
            load=self._carried.total + joint_friction,
            gravity_load=self._carried.gravity,
            tip_force=self._actual.tip_force,
        )
        q = self._position
        for effect in self._mechanical:
            q = effect(q, motion)
        self._q, seen = q, [q, q]
        for sensor, effects in enumerate(self._clocks):
            for effect in effects:
                seen[sensor] = effect(seen[sensor], motion)
        return Moment(self.machine, self._actual, motion, torque, *seen)
