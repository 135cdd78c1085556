"""The servo loop: a PD controller on each motor against inertia, load and friction, step by step, compiled.

Dry friction is set-valued (Moreau's time stepping): a step first moves freely, then friction takes away what speed it
can and no more, so that a joint really sticks and no threshold speed is needed (Acary and Brogliato 2008, Numerical
Methods for Nonsmooth Dynamical Systems, Ch. 10). Soft friction, which grows over the first speeds, is taken at the end
of a step too. Effects inside the loop act by their laws, for a whole recording and for an arm that runs live alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Drive
from gpcorrect.sim.dynamics import in_parts
from gpcorrect.sim.effects.base import SIDES, Effect, FrictionEffect, TorqueEffect
from gpcorrect.sim.effects.catalogue import of_kind
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw
from gpcorrect.sim.servo_steps import MOTOR, TINY, Given, Laws, State, advance
from gpcorrect.types import FloatArray

SETTLING = 3  # times that it is looked which stops are pressed: once more than one joint's two


@dataclass(frozen=True)
class Clock:
    """Servo steps of `step` seconds, of which every `stride`-th is a log sample."""

    step: float
    stride: int

    @classmethod
    def of(cls, rate_hz: float, log_rate_hz: float) -> Clock:
        """Return the clock of a loop, as little faster than asked as makes its steps meet the log's samples.

        Parameters
        ----------
        rate_hz, log_rate_hz : float, of the loop, and of the log
        """
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
    load : (n, N, dof) array, torque that the links ask of the motor, beyond `inertia` times its acceleration
    inertia : (dof,) array, motor and mean link inertia that the loop accelerates, kg m^2 or kg
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
    joints : tuple of int, joint numbers of the columns
    effects : sequence of Effect, of the machine; those that act in the loop are used
    """

    def __init__(self, drive: Drive, joints: tuple[int, ...], effects: Sequence[Effect]) -> None:
        frictions = [(e.column(joints), SIDES.index(e.side), e.law()) for e in of_kind(effects, FrictionEffect)]
        torques = [(e.column(joints), e.law()) for e in of_kind(effects, TorqueEffect)]
        own_frictions, own_torques = _own_laws(drive)
        frictions = sorted([*own_frictions, *frictions], key=lambda law: law[0])
        torques = sorted([*own_torques, *torques], key=lambda law: law[0])
        columns = np.arange(len(joints) + 1)
        self._drive = drive
        self._laws = Laws(
            friction=np.array([law for _, _, law in frictions]).reshape(-1, len(FrictionLaw._fields)),
            friction_of=np.searchsorted([column for column, _, _ in frictions], columns),
            friction_side=np.array([side for _, side, _ in frictions], dtype=np.int64),
            torque=np.array([law for _, law in torques]).reshape(-1, len(TorqueLaw._fields)),
            torque_of=np.searchsorted([column for column, _ in torques], columns),
        )

    def check_stable(self, inertia: FloatArray, step: float) -> None:
        """Refuse gains of which one joint's sampled loop, without load and friction, leaves the unit circle.

        Parameters
        ----------
        inertia : (dof,) array, of motor and links, kg m^2 or kg
        step : float, s

        Raises
        ------
        DataError
            A joint has no inertia, or the gains, or a stop's stiffness, make its sampled loop unstable.
        """
        held, kept, stiffness = self._held(step), _kept(self._drive, step), self._drive.kp + self._stops
        for j, (kp, kd, ki, mass) in enumerate(
            zip(stiffness, self._drive.speed_gains[0], _summing(self._drive), inertia, strict=True)
        ):
            if not mass > 0.0:
                raise DataError(
                    f"column {j + 1} has no inertia: nothing says how its motor moves.",
                    hint="Give motor_inertia (armature in a robot file), or links that weigh something.",
                )
            seen, summed = np.array([0.0, 1.0 - kept[j], kept[j], 0.0]), np.array([-step * ki, 0.0, 0.0, 1.0])
            speed = np.array([-step * kp / mass, 1.0, 0.0, 0.0]) + step / mass * (summed - kd * seen)
            moved = np.array([1.0, held[j] * step, 0.0, 0.0]) + (1.0 - held[j]) * step * speed
            loop = np.array([moved, speed, seen, summed])
            if np.abs(np.linalg.eigvals(loop)).max() > 1.0 + 1e-9:
                raise DataError(
                    f"the controller of column {j + 1} is unstable at a step of {step:.3g} s: kp (with the joint's "
                    f"stops) {kp:.4g}, kd {kd:.4g}, ki {ki:.4g}, inertia {mass:.4g}.",
                    hint="Lower kp, kd, ki or the stops' stiffness, or raise motor_inertia or rate_hz.",
                )

    @property
    def _stops(self) -> FloatArray:
        """Stiffness `(dof,)` of all stops and springs of each joint."""
        dof = len(self._drive.kp)
        stops, column = np.zeros(dof), np.repeat(np.arange(dof), np.diff(self._laws.torque_of))
        np.add.at(stops, column, self._laws.torque[:, TorqueLaw._fields.index("stiffness")])
        return stops

    def _held(self, step: float) -> FloatArray:
        """Share `(dof,)` that the speed before a step has in where it leads; the speed behind it has the rest.

        A half under a controller that holds its torque for a step, in which its motor accelerates evenly. Such a loop
        gains energy where kd < step kp / 2, which friction takes from a real one: there it is as much less as leaves
        the loop's determinant, 1 - (step kd - share step^2 kp) / inertia, at one. Nothing in a drive of a robot file,
        whose steps are MuJoCo's.
        """
        if self._drive.kv is not None:
            return np.zeros(len(self._drive.kp))
        return np.minimum(0.5, self._drive.kd / (step * (self._drive.kp + self._stops)))

    def balanced(self, desired: FloatArray, torque: FloatArray, velocity: FloatArray) -> State:
        """Return the state of motors that are held by their controllers, and by springs and stops.

        Parameters
        ----------
        desired : (N, dof) array, rad or m
        torque : (N, dof) array, what else moves them, N m or N
        velocity : (N, dof) array, at which they move all the same
        """
        kp, law = self._drive.kp, self._laws.torque
        column, sums = np.repeat(np.arange(len(kp)), np.diff(self._laws.torque_of)), _summing(self._drive) > 0.0
        at = np.where(sums, desired, desired + torque / kp)
        stiffness, pushed = np.zeros(at.shape), np.zeros(at.shape)
        for _ in range(SETTLING if law[:, [1, 4]].any() else 0):
            stiffness[:], pushed[:] = 0.0, 0.0
            for j, (_, k, upper, lower, push) in zip(column, law, strict=True):
                pushed[:, j] -= push
                if k != 0.0:
                    above, below = at[:, j] > upper, at[:, j] < lower
                    stiffness[:, j] += k * (above | below)
                    pushed[:, j] += np.where(above, k * upper, 0.0) + np.where(below, k * lower, 0.0)
            at = np.where(sums, desired, (kp * desired + torque + pushed) / (kp + stiffness))
        summed = np.where(sums, stiffness * at - torque - pushed, 0.0)
        return State(at, np.array(velocity), np.array(velocity), summed, np.zeros(at.shape))

    def run(self, reference: Reference, clock: Clock, state: State) -> ServoPath:
        """Go over a reference.

        Parameters
        ----------
        reference : Reference, of N runs
        clock : Clock, of the loop
        state : State, which is moved on in place
        """
        given, laws = _given(self._drive, reference, clock, self._held(clock.step)), self._laws
        samples = np.empty((4, *given.load.shape))
        bends = laws.friction[:, FrictionLaw._fields.index("bristle")].any()

        def move(first: int, last: int) -> None:
            advance(first, last, given, laws, state, state.bent if bends else None, samples)

        in_parts(len(given.position), given.position.size, move)
        position, velocity, torque, behind = np.ascontiguousarray(samples.swapaxes(1, 2))
        return ServoPath(position, velocity, torque / self._drive.delivered, behind)


def follow(
    drive: Drive,
    reference: Reference,
    clock: Clock,
    joints: tuple[int, ...],
    effects: Sequence[Effect],
    begins: FloatArray | None = None,
) -> ServoPath:
    """Run the loop over a reference, from a state that follows it in balance, with the effects that act in the loop.

    Parameters
    ----------
    drive : Drive
    reference, clock : Reference and Clock, what the loop is given, and its steps
    joints : tuple of int, joint numbers of the columns
    effects : sequence of Effect
    begins : (2, N, dof) array, optional, where the motors are at the start, and how fast, in place of that state

    Raises
    ------
    DataError
        The gains, or a stop's stiffness, make the sampled loop unstable.
    """
    loop = Loop(drive, joints, effects)
    loop.check_stable(reference.inertia, clock.step)
    pulled = reference.feedforward[0] - reference.load[0]
    state = loop.balanced(reference.position[:, 0], pulled, reference.velocity[:, 0])
    if begins is not None:
        state = state._replace(position=np.array(begins[0]), velocity=np.array(begins[1]), seen=np.array(begins[1]))
    return loop.run(reference, clock, state)


def _own_laws(drive: Drive) -> tuple[list[tuple[int, int, FrictionLaw]], list[tuple[int, TorqueLaw]]]:
    """Friction and limits that the drives are known to have, each with its column (and side)."""
    still = np.zeros(len(drive.kp))
    dry = still if drive.friction is None else drive.friction
    viscous = still if drive.damping is None else drive.damping
    soft = np.zeros((2, len(still))) if drive.onset is None else drive.onset
    numbers = zip(dry.tolist(), viscous.tolist(), *soft.tolist(), strict=True)
    laws = [FrictionLaw(torque, damping=damping).softened(v, time) for torque, damping, v, time in numbers]
    frictions = [(j, MOTOR, law) for j, law in enumerate(laws) if law.torque > 0 or law.damping > 0]
    limits = [] if drive.limit is None else [(j, TorqueLaw(limit=float(limit))) for j, limit in enumerate(drive.limit)]
    return frictions, [law for law in limits if np.isfinite(law[1].limit)]


def _given(drive: Drive, reference: Reference, clock: Clock, held: FloatArray) -> Given:
    gain = clock.step / reference.inertia
    before, behind = drive.speed_gains
    kp, kd, kv, gain = (np.asarray(a, dtype=np.float64) for a in (drive.kp, before, behind, gain))
    pace = reference.velocity * drive.kd / np.maximum(kd, TINY) if drive.brakes_late else reference.velocity
    carried = reference.load if reference.carried is None else reference.carried
    position, velocity = (np.ascontiguousarray(p) for p in (reference.position, pace))
    sampled = (reference.feedforward, reference.load, carried)
    feedforward, load, carried = (np.ascontiguousarray(p.swapaxes(0, 1)) for p in sampled)
    kept, ki, step, stride = _kept(drive, clock.step), _summing(drive), clock.step, clock.stride
    return Given(kp, kd, kv, ki, gain, held, kept, step, stride, position, velocity, feedforward, load, carried)


def _summing(drive: Drive) -> FloatArray:
    """Gains `(dof,)` on the sum of errors."""
    return np.zeros(len(drive.kp)) if drive.ki is None else drive.ki


def _kept(drive: Drive, step: float) -> FloatArray:
    """Share `(dof,)` of a step ago in what the filters show of the motors' speed."""
    filtered = np.zeros(len(drive.kp)) if drive.filtered is None else drive.filtered
    return np.exp(-step / np.maximum(filtered, TINY))
