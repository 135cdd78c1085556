"""The closed loop: sampled PD on motors, cables, links, friction; drift-kick-drift steps at 2 kHz, control at 1 kHz.

A joint whose cable is rigid moves as one body with its motor; a joint with an elastic cable has two masses. Friction
is LuGre's bristle (Canudas de Wit et al. 1995) or Karnopp's dead band (Karnopp 1985).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from truth.body import equations, middle_of_link_2

__all__ = ["CONTROL_HZ", "FEEDFORWARDS", "STEP", "TICK_HZ", "Loop", "Recorded", "integrate"]

Array = NDArray[np.float64]

CONTROL_HZ = 1000
TICK_HZ = 500  # rate at which the motion is kept
STEP = 0.5e-3  # s, two a control period
FEEDFORWARDS = ("none", "gravity", "rigid-body")
PRESLIDING = np.array([2e-5, 2e-5, 3e-6])  # rad, rad, m that a bristle bends before it slides
DEAD_BAND = np.array([1e-3, 1e-3, 1e-4])  # rad/s, rad/s, m/s in which Karnopp's joint may stick; above a step's gain


class Loop(NamedTuple):
    """Numbers of the machine, (3,) arrays unless said; zero is absent.

    `stiffness` (0: rigid cable), `cubic`, `length` (EA of a cable of length `length_offset` + insertion), `slack_ratio`
    (stiffness when pushed over stiffness when pulled) and `cable_damping` make the cable; `coulomb`, `static`,
    `stribeck_speed`, `waviness`, `wave_number`, `wave_phase`, `capstan` (mu times wrap angle) and `viscous` the friction,
    `lugre` (bool) its law; `stop_*` a one-sided spring; `cog_*` a torque ripple; `hose_stiffness` (float) a spring from
    link 2 to `hose_anchor`; `crossed` a torque with the sign of the motion of joint `crossed_by` (int index).
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
    slack_ratio: Array
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
    hose_stiffness: float
    hose_anchor: Array
    crossed: Array
    crossed_by: NDArray[np.int64]


class Recorded(NamedTuple):
    """Motion at the ticks, `(n, 3)` arrays: motors, links before path effects, cable torques, gravity's part, commands."""

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
    if stretch < 0.0:
        k *= p.slack_ratio[j]
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
    out[:] = 0.0
    if p.feedforward == 0:
        return
    equations(nominal, q, v, M, bias, weight)
    out += weight
    if p.feedforward == 2:
        for j in range(3):
            out[j] += bias[j] + p.motor_inertia[j] * a[j]
            for k in range(3):
                out[j] += M[j, k] * a[k]


@njit(cache=True)
def _outer(p, body, q, v, motor, motor_speed, extra, out):
    """Torques on the joints from outside the drive and the links: stops, ripple, hose, crossed friction, bumps."""
    for j in range(3):
        beyond = p.stop_side[j] * (q[j] - p.stop_place[j])
        out[j] = extra[j]
        if p.stop_stiffness[j] > 0.0 and beyond > 0.0:
            # Hunt and Crossley 1975: damping grows with the depth, so that contact starts without a jump
            out[j] -= p.stop_side[j] * p.stop_stiffness[j] * beyond * max(0.0, 1.0 + 0.3 * p.stop_side[j] * v[j])
        if p.cog_torque[j] != 0.0:
            out[j] += p.cog_torque[j] * np.sin(p.cog_number[j] * motor[j] + p.cog_phase[j])
        if p.crossed[j] != 0.0:
            out[j] -= p.crossed[j] * np.tanh(motor_speed[p.crossed_by[j]] / 2e-3)
    if p.hose_stiffness > 0.0:
        place, partial_1, partial_2 = middle_of_link_2(body, q)
        for c in range(3):
            pull = p.hose_stiffness * (p.hose_anchor[c] - place[c])
            out[0] += partial_1[c] * pull
            out[1] += partial_2[c] * pull


@njit(cache=True)
def integrate(p, nominal, body, wanted, wanted_v, wanted_a, payload, tip, offset, extra):
    """Run the loop over a reference at the control rate `(m, 3)`.

    `payload` (ticks,) kg is known and hangs at `tip` (3,) of link 3's frame; `offset` (ticks, 3) is reported minus true
    joint value by the path effects; `extra` (ticks, 3) is a torque from outside. The first sample must be at rest.
    """
    ticks = len(payload)
    kept = np.empty((6, ticks, 3))
    M, bias, weight = np.empty((3, 3)), np.empty(3), np.empty(3)
    push, acc, outer, feed = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    moved, ahead = np.empty(3), np.empty(3)
    command, load, bristle = np.zeros(3), np.zeros(3), np.zeros(3)
    hidden = body.mass[3]
    nominal.mass[3] = payload[0]
    body.mass[3] = payload[0] + hidden
    nominal.centre[3], body.centre[3] = tip, tip
    q = wanted[0] - offset[0]
    v = np.zeros(3)
    equations(body, q, v, M, bias, weight)
    load[:] = weight
    _feedforward(p, nominal, wanted[0], v, v, M, bias, acc, feed)
    motor, speed = wanted[0] + (feed - load) / p.kp, np.zeros(3)
    link, rate = motor.copy(), np.zeros(3)
    elastic = np.zeros(3, dtype=np.bool_)
    for j in range(3):
        elastic[j] = p.stiffness[j] > 0.0 or p.length[j] > 0.0
        if elastic[j]:
            stretch = 0.0
            for _ in range(50):
                slope = (cable_torque(p, j, stretch + 1e-7, 0.0, q[2]) - cable_torque(p, j, stretch, 0.0, q[2])) / 1e-7
                stretch += (load[j] - cable_torque(p, j, stretch, 0.0, q[2])) / slope
            link[j] -= stretch
    per_tick = CONTROL_HZ // TICK_HZ
    substeps = int(round(1.0 / CONTROL_HZ / STEP))
    for t in range(ticks):
        nominal.mass[3] = payload[t]
        body.mass[3] = payload[t] + hidden
        for c in range(per_tick):
            i = t * per_tick + c
            _feedforward(p, nominal, wanted[i], wanted_v[i], wanted_a[i], M, bias, weight, feed)
            for j in range(3):
                seen = motor[j]
                if p.encoder_step[j] > 0.0:
                    seen = np.round(seen / p.encoder_step[j]) * p.encoder_step[j]
                command[j] = p.kp[j] * (wanted[i, j] - seen) + p.kd[j] * (wanted_v[i, j] - speed[j]) + feed[j]
            for s in range(substeps):
                if c == 0 and s == 0:
                    for j in range(3):
                        kept[0, t, j], kept[1, t, j], kept[2, t, j] = motor[j], speed[j], link[j]
                        kept[5, t, j] = command[j]
                for j in range(3):
                    motor[j] += 0.5 * STEP * speed[j]
                    link[j] += 0.5 * STEP * rate[j]
                    q[j] = link[j] - offset[t, j]
                    ahead[j] = q[j] + 0.5 * STEP * rate[j]
                if (
                    s == 0
                ):  # the arm turns by less than 1e-3 rad in a control period: its masses are looked up once, midway
                    equations(body, ahead, rate, M, bias, weight)
                _outer(p, body, q, rate, motor, speed, extra[t], outer)
                for j in range(3):
                    torque = min(max(command[j], -p.torque_limit[j]), p.torque_limit[j])
                    mass = p.motor_inertia[j] + (0.0 if elastic[j] else M[j, j])
                    level = dry_level(p, j, motor[j], speed[j], load[j])
                    resting = torque - p.viscous[j] * speed[j]
                    moved[j] = 0.0
                    if elastic[j]:
                        passed = cable_torque(p, j, motor[j] - link[j], speed[j] - rate[j], q[2])
                        dry = dry_force(p, j, level, speed[j], resting - passed, mass, bristle)
                        acc_m = (resting - passed - dry) / (mass + STEP * p.viscous[j])
                        speed[j] += STEP * acc_m
                        push[j] = passed + outer[j] - bias[j] - weight[j]
                        load[j] = passed
                    else:
                        free = resting + outer[j] - bias[j] - weight[j]
                        dry = dry_force(p, j, level, speed[j], free, mass, bristle)
                        push[j] = free - dry
                        moved[j] = p.motor_inertia[j] + STEP * p.viscous[j]
                        load[j] = torque - dry - p.viscous[j] * speed[j]
                solve(M, moved, push, acc)
                for j in range(3):
                    rate[j] += STEP * acc[j]
                    link[j] += 0.5 * STEP * rate[j]
                    if elastic[j]:
                        motor[j] += 0.5 * STEP * speed[j]
                    else:
                        load[j] -= p.motor_inertia[j] * acc[j]
                        speed[j] = rate[j]
                        motor[j] = link[j]
                if c == 0 and s == 0:
                    for j in range(3):
                        kept[3, t, j], kept[4, t, j] = load[j], weight[j]
    body.mass[3] = hidden
    return kept
