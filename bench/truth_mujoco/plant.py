"""The machine of one run: what MuJoCo is told, and the sampled controller around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray
from truth.loop import CONTROL_HZ, TICK_HZ
from truth.reference import Reference

from truth_mujoco.arms import Arm
from truth_mujoco.body import PAYLOAD, SUBSTEPS, compiled, nominal_model

Array = NDArray[np.float64]

FEEDFORWARDS = ("none", "gravity", "rigid-body")
PER_TICK = CONTROL_HZ // TICK_HZ


@dataclass(frozen=True, eq=False)
class Plant:
    """Numbers of a machine with its hidden causes, `(k,)` arrays unless said.

    Parameters
    ----------
    arm : Arm, the machine as everybody knows it
    rows, gravity : (m, 4), (3,) arrays, true table; true free fall, base frame
    kp, kd, feedforward : arrays, str, controller, in joint units
    fed : (3, k) array
        Share of gravity torque, inertia torque and desired speed that the controller is really told.
    gains : (2, k) array, factors of kp and kd
    torque_limit : array, N m or N; infinite is none
    encoder_step : array, what the controller's encoders resolve
    elastic : bool array
        Whether a cable lies between motor and link; `stiffness`, `cubic` are its numbers, `link_inertia` sets its
        damping.
    coulomb, viscous : arrays, friction on the motors
    stop_place, stop_side, stop_stiffness : arrays, one-sided springs on the links; stiffness zero is none
    mapping, home : (k, k), (k,) arrays, reported = home + mapping (motor - home) + offset + waves
    offset : callable or None, `(reference, time at control steps) -> (m, k)` added to what is reported
    waves : tuple of (column, amplitude, number, phase), added to what is reported
    hidden_mass : float, kg at the tip that the controller does not know of
    bends : (2, 3) array or None, axes in the tip's frame across the shaft, along which it bends; None is rigid
    shapes : tuple of callables, `(spec)`: what else is built into the model
    hooks : tuple of callables
        `(model, data, reference, plant) -> step(i, t, state)`: what happens at each control step.
    """

    arm: Arm
    rows: Array
    gravity: Array
    kp: Array
    kd: Array
    feedforward: str
    fed: Array
    gains: Array
    torque_limit: Array
    encoder_step: Array
    elastic: NDArray[np.bool_]
    stiffness: Array
    cubic: Array
    link_inertia: Array
    coulomb: Array
    viscous: Array
    stop_place: Array
    stop_side: Array
    stop_stiffness: Array
    mapping: Array
    home: Array
    offset: Callable[[Reference, Array], Array] | None = None
    waves: tuple[tuple[int, float, float, float], ...] = ()
    hidden_mass: float = 0.0
    bends: Array | None = None
    shapes: tuple[Callable[[mujoco.MjSpec], None], ...] = ()
    hooks: tuple[Callable[..., Callable[[int, int, State], None]], ...] = field(default=())

    def friction_start(self, j: int) -> float:
        """Friction that the model is built with: above zero wherever a hook may raise it."""
        return max(float(self.coulomb[j]), 1e-9 if self.hooks else 0.0)

    def with_hook(self, hook: Callable[..., Callable[[int, int, State], None]]) -> Plant:
        """Return the same with a further hook."""
        return replace(self, hooks=(*self.hooks, hook))

    def with_offset(self, more: Callable[[Reference, Array], Array]) -> Plant:
        """Return the same with something more added to what is reported."""
        before = self.offset
        if before is None:
            return replace(self, offset=more)
        return replace(self, offset=lambda reference, time: before(reference, time) + more(reference, time))


def bare_plant(arm: Arm, rows: Array, gravity: Array, kp: Array, kd: Array, feedforward: str) -> Plant:
    """Return a machine without any hidden cause."""
    k = arm.dof
    zeros = np.zeros(k)
    return Plant(
        arm=arm, rows=rows, gravity=gravity, kp=kp, kd=kd, feedforward=feedforward, fed=np.ones((3, k)),
        gains=np.ones((2, k)), torque_limit=np.full(k, np.inf), encoder_step=arm.encoder_step,
        elastic=np.zeros(k, dtype=np.bool_), stiffness=zeros, cubic=zeros, link_inertia=_link_inertia(arm, gravity),
        coulomb=zeros, viscous=zeros, stop_place=zeros, stop_side=zeros, stop_stiffness=zeros, mapping=np.eye(k),
        home=arm.ranges.mean(axis=1),
    )  # fmt: skip


def _link_inertia(arm: Arm, gravity: Array) -> Array:
    """Inertia `(k,)` of the links at each joint, in the middle of its range."""
    model = nominal_model(arm, gravity)
    data = mujoco.MjData(model)
    data.qpos[: arm.dof] = arm.ranges.mean(axis=1)
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return np.diag(M) - arm.motor_inertia


@dataclass(frozen=True, eq=False)
class Recorded:
    """Motion at the ticks `(n, k)`: reported motors, links, commanded torque; and bending (n, 3), m, base frame."""

    reported: Array
    link: Array
    command: Array
    bend: Array


@dataclass(eq=False)
class State:
    """What hooks may look at: `(k,)` views of MuJoCo's arrays."""

    motor: Array
    speed: Array


def nominal_torques(plant: Plant, reference: Reference) -> Array:
    """Gravity, inertia and velocity torques `(3, n, k)` of the desired motion at the ticks, by MuJoCo's mj_inverse."""
    arm = plant.arm
    model = nominal_model(arm, plant.gravity)
    data, body = mujoco.MjData(model), model.body(PAYLOAD).id
    position, speed, acceleration = (
        values[::PER_TICK] for values in (reference.position, reference.speed, reference.acceleration)
    )
    parts = np.zeros((3, *position.shape))
    wanted = {"none": 0, "gravity": 1, "rigid-body": 3}[plant.feedforward]
    if wanted == 0:
        return parts
    mass = np.nan
    for t, (q, v, a) in enumerate(zip(position, speed, acceleration, strict=True)):
        if reference.payload[t] != mass:
            mass = reference.payload[t]
            model.body_mass[body] = mass
            mujoco.mj_setConst(model, data)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, 0.0, 0.0
        mujoco.mj_inverse(model, data)
        parts[0, t] = data.qfrc_inverse
        if wanted == 3:
            data.qacc[:] = a
            mujoco.mj_inverse(model, data)
            parts[1, t] = data.qfrc_inverse - parts[0, t]
            data.qvel[:], data.qacc[:] = v, 0.0
            mujoco.mj_inverse(model, data)
            parts[2, t] = data.qfrc_inverse - parts[0, t]
    return parts


@njit(cache=True)
def _control(motor, speed, wanted, wanted_v, feed, kp, kd, step, mapping, home, offset, waves, seen, command):
    """Fill what is reported and the torques of a PD on it."""
    for j in range(len(motor)):
        value, rate = home[j] + offset[j], 0.0
        for k in range(len(motor)):
            value += mapping[j, k] * (motor[k] - home[k])
            rate += mapping[j, k] * speed[k]
        for w in range(len(waves)):
            if waves[w, 0] == j:
                value += waves[w, 1] * np.sin(waves[w, 2] * motor[j] + waves[w, 3])
        seen[j] = value
        counted = np.round(value / step[j]) * step[j] if step[j] > 0.0 else value
        command[j] = kp[j] * (wanted[j] - counted) + kd[j] * (wanted_v[j] - rate) + feed[j]


def integrate(plant: Plant, reference: Reference, torques: Array) -> Recorded:
    """Let a machine follow a reference.

    Parameters
    ----------
    plant : Plant, the machine
    reference : Reference, desired motion, from rest
    torques : (3, n, k) array, of :func:`nominal_torques`, for the machine as its controller knows it
    """
    model = compiled(plant)
    data, k = mujoco.MjData(model), plant.arm.dof
    qpos_of = np.array([model.joint(_motor(plant, j)).qposadr[0] for j in range(k)])
    dof_of = np.array([model.joint(_motor(plant, j)).dofadr[0] for j in range(k)])
    payload = model.body(PAYLOAD).id
    feed = plant.fed[0] * torques[0] + plant.fed[1] * torques[1] + torques[2]
    steps = len(reference.position)
    clock = np.repeat(reference.session_time, PER_TICK) + np.tile(np.arange(PER_TICK) / CONTROL_HZ, steps // PER_TICK)
    offset = np.zeros((1, k)) if plant.offset is None else plant.offset(reference, clock)
    many = len(offset) > 1
    waves = np.array(plant.waves, dtype=np.float64).reshape(-1, 4)
    kp, kd = plant.kp * plant.gains[0], plant.kd * plant.gains[1]
    _at_rest(plant, model, data, reference, feed[0], offset[0], qpos_of)
    state = State(data.qpos[qpos_of], data.qvel[dof_of])
    hooks = [hook(model, data, reference, plant) for hook in plant.hooks]
    n = len(reference.time)
    kept = Recorded(np.empty((n, k)), np.empty((n, k)), np.empty((n, k)), np.zeros((n, 3)))
    seen, command, mass = np.empty(k), np.empty(k), np.nan
    qpos, qvel, ctrl = data.qpos, data.qvel, data.ctrl
    wanted, wanted_v = reference.position, reference.speed * plant.fed[2]
    bends = [] if plant.bends is None else [model.joint(f"bend{i}").qposadr[0] for i in range(2)]
    for i in range(steps):
        t = i // PER_TICK
        ticking = i % PER_TICK == 0
        if ticking and reference.payload[t] != mass:
            mass = reference.payload[t]
            _load(model, data, payload, mass + plant.hidden_mass)
        state.motor, state.speed = qpos[qpos_of], qvel[dof_of]
        now = offset[i] if many else offset[0]
        _control(
            state.motor, state.speed, wanted[i], wanted_v[i], feed[t], kp, kd, plant.encoder_step, plant.mapping,
            plant.home, now, waves, seen, command,
        )  # fmt: skip
        ctrl[:k] = command
        for hook in hooks:
            hook(i, t, state)
        if ticking:
            kept.reported[t], kept.link[t], kept.command[t] = seen, qpos[:k], command
            if bends:
                kept.bend[t] = data.xmat[payload].reshape(3, 3) @ (plant.bends.T @ qpos[bends])
        mujoco.mj_step(model, data, SUBSTEPS)
    return kept


def _motor(plant: Plant, j: int) -> str:
    return f"motor{j + 1}" if plant.elastic[j] else f"joint{j + 1}"


def _load(model: mujoco.MjModel, data: mujoco.MjData, body: int, mass: float) -> None:
    """Hang a mass at the tip, the motion as it is."""
    before = np.array(data.qpos), np.array(data.qvel), data.time
    model.body_mass[body] = max(mass, 1e-6)
    mujoco.mj_setConst(model, data)
    data.qpos[:], data.qvel[:], data.time = before


def _at_rest(
    plant: Plant,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    reference: Reference,
    feed: Array,
    offset: Array,
    qpos_of: NDArray[np.int64],
) -> None:
    """Place the arm where the controller about holds its weight; what is missing fades in the unlogged first second."""
    k = plant.arm.dof
    _load(model, data, model.body(PAYLOAD).id, reference.payload[0] + plant.hidden_mass)
    start = np.linalg.solve(plant.mapping, reference.position[0] - offset - plant.home) + plant.home
    data.qpos[:k], data.qpos[qpos_of] = start, start
    mujoco.mj_forward(model, data)
    sag = (feed - data.qfrc_bias[:k]) / (plant.kp * plant.gains[0])
    data.qpos[:k] += sag
    data.qpos[qpos_of] = start + sag
    for j in np.flatnonzero(plant.elastic):
        data.qpos[j] -= data.qfrc_bias[j] / plant.stiffness[j]
    mujoco.mj_forward(model, data)
