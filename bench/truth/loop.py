"""The closed loop: sampled PD on motors, cables, links, friction; drift-kick-drift steps at 2 kHz, control at 1 kHz.

A joint whose cable is rigid moves as one body with its motor; a joint with an elastic cable has two masses. Friction
is LuGre's bristle (Canudas de Wit et al. 1995) or Karnopp's dead band (Karnopp 1985).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from truth.body import equations

Array = NDArray[np.float64]

CONTROL_HZ = 1000
TICK_HZ = 500  # rate at which the motion is kept
STEP = 0.5e-3  # s
SUBSTEPS = 2  # a control period
COG_SLOTS = 1.4  # slots for each pole, of which both ripple
FEEDFORWARDS = ("none", "gravity", "rigid-body")
PRESLIDING = np.array([2e-5, 2e-5, 3e-6])  # rad, rad, m that a bristle bends before it slides
DEAD_BAND = np.array([1e-3, 1e-3, 1e-4])  # rad/s, rad/s, m/s in which Karnopp's joint may stick; above a step's gain


class Loop(NamedTuple):
    """Numbers of the machine, (3,) arrays unless said; zero is absent.

    `stiffness` (0: rigid cable), `cubic`, `length` (EA of a cable of length `length_offset` + insertion), and
    `cable_damping` make the cable; `coulomb`, `static`, `stribeck_speed`, `waviness`, `wave_number`, `wave_phase`,
    `capstan` (mu times wrap angle) and `viscous` the friction, `lugre` (bool) its law; `stop_*` a one-sided spring;
    `cog_*` a torque ripple.
    """

    kp: Array
    kd: Array
    motor_inertia: Array
    feedforward: int
    encoder_step: Array
    torque_limit: Array
    stiffness: Array
    cubic: Array
    length: Array
    length_offset: Array
    cable_damping: Array
    coulomb: Array
    static: Array
    stribeck_speed: Array
    waviness: Array
    wave_number: Array
    wave_phase: Array
    capstan: Array
    viscous: Array
    lugre: bool
    stop_place: Array
    stop_side: Array
    stop_stiffness: Array
    cog_torque: Array
    cog_number: Array
    cog_phase: Array


class Recorded(NamedTuple):
    """Motion at the ticks, `(n, 3)` arrays: motors, links before path effects, cables' load, weight, commands."""

    motor: Array
    speed: Array
    link: Array
    load: Array
    weight: Array
    command: Array


@njit(cache=True)
def cable_torque(p, j, stretch, rate, insertion):
    """Torque that a stretched cable passes on."""
    k = p.stiffness[j]
    if p.length[j] > 0.0:
        k = p.length[j] / (p.length_offset[j] + insertion)
    return k * stretch + p.cubic[j] * stretch**3 + p.cable_damping[j] * rate


@njit(cache=True)
def dry_level(p, j, q, speed, load):
    """Dry friction while sliding at a speed under a load."""
    level = p.coulomb[j]
    if level == 0.0 and p.capstan[j] == 0.0:
        return 0.0
    if p.static[j] > level:
        level += (p.static[j] - level) * np.exp(-((speed / p.stribeck_speed[j]) ** 2))
    level *= 1.0 + p.waviness[j] * np.sin(p.wave_number[j] * q + p.wave_phase[j])
    if p.capstan[j] > 0.0:
        against = speed * load >= 0.0
        level += abs(load) * (np.exp(p.capstan[j]) - 1.0 if against else 1.0 - np.exp(-p.capstan[j]))
    return level


@njit(cache=True)
def dry_force(p, j, level, speed, push, mass, bristle):
    """Dry friction torque; the bristle's bend (share of its greatest) is moved on by one step."""
    if level <= 0.0:
        return 0.0
    if p.lugre:
        before = bristle[j]
        toward = 1.0 if speed > 0 else -1.0
        bristle[j] = toward + (before - toward) * np.exp(-abs(speed) * STEP / PRESLIDING[j])
        bent = level * bristle[j]
        micro = 0.7 * np.sqrt(level / PRESLIDING[j] * mass) * PRESLIDING[j] * (bristle[j] - before) / STEP
        return min(max(bent + micro, -1.5 * level), 1.5 * level)
    if abs(speed) > DEAD_BAND[j]:
        return level * np.sign(speed)
    return min(max(push + mass * speed / STEP, -level), level)  # what brings it to rest, if the friction can


@njit(cache=True)
def solve(M, added, b, x):
    """Solve (M + diag(added)) x = b, symmetric positive 3 x 3, by Cholesky."""
    l00 = np.sqrt(M[0, 0] + added[0])
    l10, l20 = M[1, 0] / l00, M[2, 0] / l00
    l11 = np.sqrt(M[1, 1] + added[1] - l10 * l10)
    l21 = (M[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(M[2, 2] + added[2] - l20 * l20 - l21 * l21)
    y0 = b[0] / l00
    y1 = (b[1] - l10 * y0) / l11
    y2 = (b[2] - l20 * y0 - l21 * y1) / l22
    x[2] = y2 / l22
    x[1] = (y1 - l21 * x[2]) / l11
    x[0] = (y0 - l10 * x[1] - l20 * x[2]) / l00


@njit(cache=True)
def _feedforward(p, nominal, q, v, a, M, bias, weight, out):
    for j in range(3):
        out[j] = 0.0
    if p.feedforward == 0:
        return
    equations(nominal, q, v, M, bias, weight)
    for j in range(3):
        out[j] += weight[j]
        if p.feedforward == 2:
            out[j] += bias[j] + p.motor_inertia[j] * a[j]
            for k in range(3):
                out[j] += M[j, k] * a[k]


@njit(cache=True)
def _outer(p, q, v, motor, extra, out):
    """Torques on the joints from outside the drive and the links: stops, ripple, bumps."""
    for j in range(3):
        beyond = p.stop_side[j] * (q[j] - p.stop_place[j])
        out[j] = extra[j]
        if p.stop_stiffness[j] > 0.0 and beyond > 0.0:
            # Hunt and Crossley 1975: damping grows with the depth, so that contact starts without a jump
            out[j] -= p.stop_side[j] * p.stop_stiffness[j] * beyond * max(0.0, 1.0 + 0.3 * p.stop_side[j] * v[j])
        if p.cog_torque[j] != 0.0:
            turn = p.cog_number[j] * motor[j] + p.cog_phase[j]
            out[j] += p.cog_torque[j] * (np.sin(turn) + np.sin(COG_SLOTS * turn))


class _State(NamedTuple):
    """What moves, `(3,)` arrays, and what the hot loop works with."""

    motor: Array
    speed: Array
    link: Array
    rate: Array
    load: Array
    bristle: Array
    command: Array
    elastic: NDArray[np.bool_]
    M: Array
    bias: Array
    weight: Array


@njit(cache=True)
def _unloaded_stretch(p, j, load, insertion):
    """Stretch at which a cable carries a load at rest, by Newton's method."""
    stretch = 0.0
    for _ in range(50):
        here = cable_torque(p, j, stretch, 0.0, insertion)
        slope = (cable_torque(p, j, stretch + 1e-7, 0.0, insertion) - here) / 1e-7
        stretch += (load - here) / slope
    return stretch


@njit(cache=True)
def _balanced(p, nominal, body, wanted, offset):
    """Make a state at rest in which the controller holds the arm's weight."""
    M, bias, weight, feed, still = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    load, motor, link, elastic = np.empty(3), np.empty(3), np.empty(3), np.zeros(3, dtype=np.bool_)
    for j in range(3):
        link[j] = wanted[j] - offset[j]
    equations(body, link, still, M, bias, weight)
    for j in range(3):
        load[j] = weight[j]
    _feedforward(p, nominal, wanted, still, still, M, bias, weight, feed)
    for j in range(3):
        motor[j] = wanted[j] + (feed[j] - load[j]) / p.kp[j]
        link[j] = motor[j]
        elastic[j] = p.stiffness[j] > 0.0 or p.length[j] > 0.0
        if elastic[j]:
            link[j] -= _unloaded_stretch(p, j, load[j], wanted[2])
    return _State(motor, np.zeros(3), link, np.zeros(3), load, np.zeros(3), np.zeros(3), elastic, M, bias, np.empty(3))


@njit(cache=True)
def _control(p, state, wanted, wanted_v, feed):
    """Set the command from what the encoders say."""
    for j in range(3):
        seen = state.motor[j]
        if p.encoder_step[j] > 0.0:
            seen = np.round(seen / p.encoder_step[j]) * p.encoder_step[j]
        state.command[j] = p.kp[j] * (wanted[j] - seen) + p.kd[j] * (wanted_v[j] - state.speed[j]) + feed[j]


@njit(cache=True)
def _kick(p, state, q, outer, push, moved):
    """Kick the motors of elastic joints; fill `push` and `moved`, the torques and added masses of what is coupled."""
    M, bias, weight = state.M, state.bias, state.weight
    for j in range(3):
        speed, elastic = state.speed[j], state.elastic[j]
        torque = min(max(state.command[j], -p.torque_limit[j]), p.torque_limit[j])
        mass = p.motor_inertia[j] + (0.0 if elastic else M[j, j])
        level = dry_level(p, j, state.motor[j], speed, state.load[j])
        resting = torque - p.viscous[j] * speed
        if elastic:
            passed = cable_torque(p, j, state.motor[j] - state.link[j], speed - state.rate[j], q[2])
            dry = dry_force(p, j, level, speed, resting - passed, mass, state.bristle)
            state.speed[j] += STEP * (resting - passed - dry) / (mass + STEP * p.viscous[j])
            push[j] = passed + outer[j] - bias[j] - weight[j]
            moved[j], state.load[j] = 0.0, passed
        else:
            free = resting + outer[j] - bias[j] - weight[j]
            dry = dry_force(p, j, level, speed, free, mass, state.bristle)
            push[j] = free - dry
            moved[j], state.load[j] = p.motor_inertia[j] + STEP * p.viscous[j], resting - dry


@njit(cache=True)
def _half_drift(state):
    """Move every body on by half a step."""
    for j in range(3):
        state.link[j] += 0.5 * STEP * state.rate[j]
        state.motor[j] = state.motor[j] + 0.5 * STEP * state.speed[j] if state.elastic[j] else state.link[j]


@njit(cache=True)
def _step(p, body, state, offset, extra, fresh, work):
    """Make one drift-kick-drift step; the masses' terms are renewed once a control period, when `fresh`, midway.

    The arm turns by less than 1e-3 rad in that time.
    """
    q, ahead, outer, push, moved, acc = work[0], work[1], work[2], work[3], work[4], work[5]
    _half_drift(state)
    for j in range(3):
        q[j] = state.link[j] - offset[j]
        ahead[j] = q[j] + 0.5 * STEP * state.rate[j]
    if fresh:
        equations(body, ahead, state.rate, state.M, state.bias, state.weight)
    _outer(p, q, state.rate, state.motor, extra, outer)
    _kick(p, state, q, outer, push, moved)
    solve(state.M, moved, push, acc)
    for j in range(3):
        state.rate[j] += STEP * acc[j]
        if not state.elastic[j]:
            state.load[j] -= p.motor_inertia[j] * acc[j]
            state.speed[j] = state.rate[j]
    _half_drift(state)


@njit(cache=True)
def integrate(p, nominal, body, wanted, wanted_v, wanted_a, payload, tip, offset, extra):
    """Run the loop over a reference at the control rate `(m, 3)`.

    `payload` (ticks,) kg is known and hangs at `tip` (3,) of link 3's frame; `offset` (ticks, 3) is reported minus true
    joint value by the path effects; `extra` (ticks, 3) is a torque from outside. The first sample must be at rest.
    Both bodies' fourth mass is overwritten.
    """
    kept = np.empty((6, len(payload), 3))
    hidden = body.mass[3]
    nominal.mass[3], body.mass[3] = payload[0], payload[0] + hidden
    for j in range(3):
        nominal.centre[3, j], body.centre[3, j] = tip[j], tip[j]
    state = _balanced(p, nominal, body, wanted[0], offset[0])
    work, feed = np.empty((6, 3)), np.empty(3)
    M, bias, weight = np.empty((3, 3)), np.empty(3), np.empty(3)
    per_tick, substeps = CONTROL_HZ // TICK_HZ, SUBSTEPS
    for i in range(len(payload) * per_tick):
        t = i // per_tick
        nominal.mass[3], body.mass[3] = payload[t], payload[t] + hidden
        _feedforward(p, nominal, wanted[i], wanted_v[i], wanted_a[i], M, bias, weight, feed)
        _control(p, state, wanted[i], wanted_v[i], feed)
        for s in range(substeps):
            ticking = s == 0 and i % per_tick == 0
            if ticking:
                for j in range(3):
                    kept[0, t, j], kept[1, t, j] = state.motor[j], state.speed[j]
                    kept[2, t, j], kept[5, t, j] = state.link[j], state.command[j]
            _step(p, body, state, offset[t], extra[t], s == 0, work)
            if ticking:
                for j in range(3):
                    kept[3, t, j], kept[4, t, j] = state.load[j], state.weight[j]
    return kept
