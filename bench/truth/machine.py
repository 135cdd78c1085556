"""The machine of one case, drawn anew: gains, mounting, and the errors that no one is asked to find."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truth.arm import CENTRES, GRAVITY, INERTIAS, MASSES, MOTOR_INERTIA, ROWS, forward, tip_in_shaft
from truth.body import Body
from truth.hidden import Hidden
from truth.history import History, Readings
from truth.kinds import STAGES, kind_named
from truth.loop import FEEDFORWARDS, Loop, Recorded, integrate
from truth.reference import Reference

Array = NDArray[np.float64]

ENCODER_STEP = np.array([1.15e-5, 1.3e-5, 7.3e-7])  # rad, rad, m at the joint
BANDWIDTH_HZ = (5.0, 9.0)
DAMPING_RATIO = (0.9, 1.2)
TILT = 0.1  # rad; standard deviation of the mounting about the usual one, known
NUISANCE_ANGLE, NUISANCE_LENGTH = 6e-5, 8e-6  # rad, m; standard deviations of unknown table errors, under the noise


@dataclass(frozen=True, eq=False)
class Machine:
    """What is fixed about a case before anything is hidden in it; tool poses are only computed when `tracked`."""

    loop: Loop
    gravity: Array
    rows: Array
    T_tracker_base: Array
    tracked: bool = True

    def nominal_body(self) -> Body:
        """Body as the controller knows it."""
        return _body(ROWS, self.gravity)

    def true_body(self) -> Body:
        """Body with the nuisance errors of its table."""
        return _body(self.rows, self.gravity)


def _body(rows: Array, gravity: Array) -> Body:
    return Body(
        np.array(rows), np.append(MASSES, 0.0), np.vstack([CENTRES, np.zeros(3)]),
        np.vstack([INERTIAS, np.zeros(3)]), gravity,
    )  # fmt: skip


def draw_machine(rng: np.random.Generator, *, tracked: bool) -> Machine:
    """Draw gains, feedforward, mounting, registration and nuisance."""
    omega = 2 * np.pi * rng.uniform(*BANDWIDTH_HZ)
    kp = np.round(MOTOR_INERTIA * omega**2 * rng.uniform(0.85, 1.15, 3), 3)
    kd = np.round(2 * rng.uniform(*DAMPING_RATIO, 3) * np.sqrt(kp * MOTOR_INERTIA), 3)
    gravity = Rotation.from_rotvec(TILT * rng.standard_normal(3)).apply(GRAVITY)
    rows = ROWS + rng.standard_normal(ROWS.shape) * [NUISANCE_ANGLE, NUISANCE_LENGTH, NUISANCE_LENGTH, NUISANCE_ANGLE]
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    loop = _plain_loop(kp, kd, int(rng.integers(len(FEEDFORWARDS))), bool(rng.random() < 0.5))
    return Machine(loop, gravity, rows, T, tracked)


def _plain_loop(kp: Array, kd: Array, feedforward: int, lugre: bool) -> Loop:
    values: dict[str, Any] = {name: np.zeros(3) for name in Loop._fields}
    return Loop(**values)._replace(
        kp=kp, kd=kd, motor_inertia=MOTOR_INERTIA.copy(), feedforward=feedforward, encoder_step=ENCODER_STEP.copy(),
        torque_limit=np.full(3, np.inf), stribeck_speed=np.ones(3), lugre=lugre,
    )  # fmt: skip


def simulate(
    machine: Machine, reference: Reference, hidden: Sequence[Hidden] = (), before: Recorded | None = None
) -> tuple[History, Readings]:
    """Run a machine with its hidden causes.

    Parameters
    ----------
    machine, reference, hidden :
        What runs, along what, with what.
    before : Recorded, optional, motion of the machine without any cause, to spare a run
    """
    parts = sorted(hidden, key=lambda h: STAGES.index(h.name) if h.name in STAGES else -1)
    on_path = [h for h in parts if kind_named(h.name).path]
    in_loop = [h for h in parts if kind_named(h.name).loop or kind_named(h.name).force]
    still = np.zeros((len(reference.time), 3))
    motion = before
    if motion is None or in_loop:
        motion = _integrate(machine, reference, in_loop, still)
    if on_path:
        offset = motion.link - _path(History(reference, motion, machine.gravity), on_path)
        motion = _integrate(machine, reference, in_loop, offset)
    history = History(reference, motion, machine.gravity)
    return history, readings_of(machine, history, parts)


def _integrate(machine: Machine, reference: Reference, hidden: Sequence[Hidden], offset: Array) -> Recorded:
    loop, body = machine.loop, machine.true_body()
    extra = np.zeros_like(offset)
    for h in hidden:
        kind = kind_named(h.name)
        if kind.loop:
            loop, body = kind.loop(h.params, h.column, loop, body)
        if kind.force:
            nothing = Recorded(*(np.zeros((0, 3)) for _ in Recorded._fields))
            extra = extra + kind.force(h.params, h.column, History(reference, nothing, machine.gravity))
    return Recorded(
        *integrate(
            loop, machine.nominal_body(), body, reference.position, reference.speed, reference.acceleration,
            reference.payload, tip_in_shaft(), offset, extra,
        )
    )  # fmt: skip


def _path(history: History, hidden: Sequence[Hidden]) -> Array:
    """Return true joint path `(n, 3)`."""
    q = history.motion.link
    for h in hidden:
        act = kind_named(h.name).path
        if act:
            q = q - act(h.params, h.column, history, q)
    return q


def readings_of(machine: Machine, history: History, hidden: Sequence[Hidden]) -> Readings:
    """Return what sensors could read of a motion; causes on the path act on it, but not back on the load."""
    q = _path(history, hidden)
    T = forward(q, machine.rows) if machine.tracked else np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for h in hidden:
        act = kind_named(h.name).tip
        if act and machine.tracked:
            T = act(h.params, h.column, history, q, T)
    readings = Readings(q, history.motion.motor, history.motion.command, T, np.zeros_like(q))
    for h in hidden:
        read = kind_named(h.name).read
        if read:
            readings = read(h.params, h.column, history, readings)
    return readings
