"""Causes that no catalogue lists: what a workflow must call unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth import alike
from truth.arm import RANGES
from truth.body import Body
from truth.history import History, Readings
from truth.kinds.kind import GAIN, Array, Kind, Params, Scene, at, column
from truth.loop import Loop
from truth.operators import warm_up

MIDDLE = RANGES.mean(axis=1)
HALF = 0.5 * np.ptp(RANGES, axis=1)


def _span(q: Array) -> Array:
    """Joint values as shares of half their range, -1 to 1."""
    return (q - MIDDLE) / HALF


def _draw_cogging(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Poles pass teeth some times a motor turn; the motor turns about 130 times (2160 a metre) as far as the joint."""
    number = float(scene.unit(j, 130.0, 2160.0) * rng.integers(1, 4))
    return {"torque": 1.6 * GAIN[j] * float(scene.noise[j]), "cycles": number, "phase": alike.phase(rng)}


def _cogging(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        cog_torque=at(loop.cog_torque, j, params["torque"]),
        cog_number=at(loop.cog_number, j, params["cycles"]),
        cog_phase=at(loop.cog_phase, j, params["phase"]),
    )
    return changed, body


def _draw_quadratic(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"source": scene.other(rng, j) + 1, "amplitude": alike.sign(rng) * 2.5 * float(scene.noise[j])}


def _quadratic(params: Params, j: int, history: History, q: Array) -> Array:
    x = _span(q)
    return column(len(q), j, params["amplitude"] * (x[:, params["source"] - 1] ** 2 - 0.5 * x[:, j] ** 2))


def _draw_thermal_bend(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "amplitude": alike.sign(rng) * 3.0 * float(scene.noise[j]),
        "time_constant": float(rng.uniform(60.0, 200.0)),
        "source": scene.other(rng, j) + 1,
    }


def _thermal_bend(params: Params, j: int, history: History, q: Array) -> Array:
    """Motion heats one side of a link: the bend follows the motors' power and ripples with another joint."""
    power = (history.motion.speed[:, j] / (2 * HALF[j])) ** 2
    warm = warm_up(history.reference.session_time, power / power.mean(), params["time_constant"])
    return column(len(q), j, params["amplitude"] * warm * np.sin(6.0 * _span(q)[:, params["source"] - 1]))


def _interpolation(params: Params, j: int, history: History, q: Array) -> Array:
    """Unequal, unsquare sine and cosine tracks: first, second and fourth harmonics of the period, alike in size."""
    turn = params["cycles"] * q[:, j] + params["phase"]
    wave = np.sin(turn) + 0.9 * np.sin(2 * turn + 1.1) + 0.8 * np.sin(4 * turn - 0.4)
    return column(len(q), j, params["amplitude"] * wave)


def _draw_mesh(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "amplitude": 2.4 * float(scene.noise[j]),
        "teeth": float(rng.uniform(3.0, 5.0)),
        "phase": alike.phase(rng),
    }


def _mesh(params: Params, j: int, history: History, q: Array) -> Array:
    """Teeth that creep and snap: a saw tooth whose pitch and depth grow along the wheel."""
    x = _span(q)[:, j]
    turn = params["teeth"] * (x + 0.4 * x**2) + params["phase"] / (2 * np.pi)
    return column(len(q), j, params["amplitude"] * (turn - np.floor(turn) - 0.5) * (1.0 + 0.8 * x))


def _draw_depth_scale(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    direction = rng.standard_normal(3)
    return {"gain": alike.sign(rng) * 0.1, "axis": (direction / np.linalg.norm(direction)).tolist()}


def _depth_scale(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    """Badly calibrated cameras: what is farther along their axis looks larger, quadratically."""
    moved = np.array(T)
    middle = T[:, :3, 3].mean(axis=0)
    depth = (T[:, :3, 3] - middle) @ np.array(params["axis"])
    moved[:, :3, 3] += params["gain"] * depth[:, None] / 0.05 * (T[:, :3, 3] - middle)
    return moved


def _draw_stick(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "reach": 3.0 * float(scene.noise[j]),
        "every": float(rng.uniform(4.0, 8.0)),
        "seconds": float(rng.uniform(0.8, 2.0)),
        "seed": int(rng.integers(2**31)),
    }


def _stick(params: Params, j: int, history: History, q: Array) -> Array:
    """Now and then the cable is caught: the joint stays behind by at most `reach`, and comes free with a jump."""
    rng = np.random.default_rng(params["seed"])
    time = history.reference.time
    error = np.zeros(len(q))
    moment = float(rng.exponential(params["every"]))
    while moment < time[-1]:
        rows = slice(*np.searchsorted(time, [moment, moment + params["seconds"] * rng.uniform(0.5, 1.5)]))
        if rows.stop > rows.start:
            error[rows] = np.clip(q[rows, j] - q[rows.start, j], -params["reach"], params["reach"])
        moment += params["seconds"] * 1.5 + float(rng.exponential(params["every"]))
    return column(len(q), j, error)


def _draw_vibration(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "amplitude": 1.4 * float(scene.noise[j]),
        "frequency": float(rng.uniform(0.7, 9.0)),
        "phase": alike.phase(rng),
    }


def _vibration(params: Params, j: int, history: History, readings: Readings) -> Readings:
    """Model this: a pump beside the table shakes the outside sensor, whatever the arm does."""
    wave = np.sin(2 * np.pi * params["frequency"] * history.reference.time + params["phase"])
    return replace(readings, outside=readings.outside + column(len(wave), j, params["amplitude"] * wave))


def _draw_bumps(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "torque": 4.0 * GAIN[j] * float(scene.noise[j]),
        "every": float(rng.uniform(3.0, 6.0)),
        "seed": int(rng.integers(2**31)),
    }


def _bumps(params: Params, j: int, history: History) -> Array:
    """Someone leans on the arm at random moments, either way, for about half a second."""
    rng = np.random.default_rng(params["seed"])
    time = history.reference.time
    torque = np.zeros(len(time))
    moment = float(rng.exponential(params["every"]))
    while moment < time[-1]:
        near = slice(*np.searchsorted(time, [moment - 1.5, moment + 1.5]))
        width = rng.uniform(0.15, 0.35)
        torque[near] += rng.normal() * np.exp(-0.5 * ((time[near] - moment) / width) ** 2)
        moment += float(rng.exponential(params["every"]))
    return column(len(time), j, params["torque"] * torque)


def _spiral(params: Params, j: int, history: History, q: Array) -> Array:
    """Model this: a cable that climbs over the turns of another one on a shared drum."""
    x = _span(q)
    return column(len(q), j, params["amplitude"] * np.sin(4.0 * x[:, j]) * np.sin(4.0 * x[:, params["source"] - 1]))


def _draw_differential(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    source = scene.other(rng, j)
    return {
        "amplitude": 1.4 * float(scene.noise[j]),
        "source": source + 1,
        "waves": float(rng.uniform(3.0, 5.0) / HALF[j]),
        "source_waves": float(alike.sign(rng) * rng.uniform(3.0, 5.0) / HALF[source]),
        "phase": alike.phase(rng),
    }


def _differential(params: Params, j: int, history: History, q: Array) -> Array:
    """Turn a wheel by two joints together, as in a differential, off its centre."""
    turn = params["waves"] * q[:, j] + params["source_waves"] * q[:, params["source"] - 1] + params["phase"]
    return column(len(q), j, params["amplitude"] * np.sin(turn))


def _draw_toggle(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    place = float(np.quantile(scene.path(j), rng.uniform(0.35, 0.65)))
    return {"amplitude": alike.sign(rng) * float(scene.noise[j]), "place": place}


def _toggle(params: Params, j: int, history: History, q: Array) -> Array:
    """Model this: a latch at one place flips each time the joint goes by upwards, to and fro between two zeros."""
    above = q[:, j] > params["place"]
    passed = np.cumsum(np.r_[False, above[1:] & ~above[:-1]])
    return column(len(q), j, params["amplitude"] * (2.0 * (passed % 2) - 1.0))


KINDS = {
    "magnetic_cogging": Kind(_draw_cogging, grow=("torque",), loop=_cogging),
    "quadratic_coupling": Kind(_draw_quadratic, grow=("amplitude",), path=_quadratic, bare=True),
    "thermal_gradient_bend": Kind(_draw_thermal_bend, grow=("amplitude",), path=_thermal_bend, bare=True),
    "encoder_interpolation": Kind(alike.draw_interpolation, grow=("amplitude",), path=_interpolation, bare=True),
    "gear_mesh": Kind(_draw_mesh, grow=("amplitude",), path=_mesh, bare=True),
    "tracker_depth_scale": Kind(_draw_depth_scale, where="base", grow=("gain",), tip=_depth_scale, tracker_only=True),
    "intermittent_stick": Kind(_draw_stick, grow=("reach",), path=_stick, bare=True),
    "outside_vibration": Kind(_draw_vibration, grow=("amplitude",), read=_vibration, bare=True),
    "differential_wheel": Kind(_draw_differential, grow=("amplitude",), path=_differential, bare=True),
    "toggling_latch": Kind(_draw_toggle, grow=("amplitude",), path=_toggle, bare=True),
    "random_bumps": Kind(_draw_bumps, grow=("torque",), force=_bumps),
    "climbing_cable": Kind(alike.draw_climbing, grow=("amplitude",), path=_spiral, bare=True),
}
