"""Causes that no catalogue lists: what a workflow must call unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from truth import alike
from truth.operators import warm_up
from truth.reference import Reference

from truth_mujoco.causes.cause import Array, Cause, Params, Scene, column
from truth_mujoco.causes.reversal import Level, friction_hook
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant, State
from truth_mujoco.stages import mode, plays, ring

Step = Callable[[int, int, State], None]


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def _span(run: Run, q: Array) -> Array:
    """Joint values as shares of half their range, -1 to 1."""
    low, high = run.plant.arm.ranges.T
    return (2 * q - low - high) / (high - low)


def _draw_growth(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "amplitude": alike.sign(rng) * 3.0 * float(scene.noise[j]),
        "time_constant": float(rng.uniform(40.0, 150.0)),
        "source": scene.other(rng, j) + 1,
    }


def _growth(params: Params, j: int, run: Run, q: Array) -> Array:
    """Let a link grow with the power its motor took lately, and lean as another joint places its load."""
    power = run.recorded.command[:, j] ** 2 + 1e-12
    warm = warm_up(run.reference.session_time, power / power.mean(), params["time_constant"])
    lean = np.sin(5.0 * _span(run, q)[:, params["source"] - 1])
    return column(len(q), q.shape[1], j, params["amplitude"] * warm * lean)


def _draw_sway(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    axis = rng.standard_normal(3)
    lean = np.cross(axis, scene.run.plant.gravity)
    return {
        "angle": 0.02,
        "axis": (lean / np.linalg.norm(lean)).tolist(),
        "frequency": float(rng.uniform(0.05, 0.4)),
        "phase": alike.phase(rng),
    }


def _swing(params: Params, time: Array) -> Array:
    turn = 2 * np.pi * params["frequency"] * time + params["phase"]
    return params["angle"] * (np.sin(turn) + 0.5 * np.sin(1.618 * turn))


def _sway(params: Params, j: int, plant: Plant) -> Plant:
    """Tilt the base to and fro: free fall turns in its frame."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant) -> Step:
        angle = _swing(params, reference.time)
        axis = np.array(params["axis"])

        def step(i: int, t: int, state: State) -> None:
            model.opt.gravity[:] = plant.gravity - angle[t] * np.cross(axis, plant.gravity)

        return step

    return plant.with_hook(hook)


def _swayed(params: Params, j: int, run: Run, T: Array) -> Array:
    turn = _swing(params, run.reference.time)[:, None] * np.array(params["axis"])
    return alike.turned(T, turn, np.cross(turn, T[:, :3, 3]))


def _draw_derailing(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"amplitude": 2.2 * float(scene.noise[j]), "every": float(rng.uniform(6.0, 12.0)), "seed": _seed(rng)}


def _derailing(params: Params, j: int, run: Run, q: Array) -> Array:
    """Now and then the cable leaves its groove, runs on another radius for a while, and falls back."""
    time, x = run.reference.time, _span(run, q)[:, j]
    error = np.zeros(len(q))
    for moment, rng in alike.moments(params["seed"], params["every"], time[-1]):
        rows = slice(*np.searchsorted(time, [moment, moment + rng.uniform(1.0, 5.0)]))
        error[rows] = params["amplitude"] * (rng.normal() + rng.normal() * x[rows])
    return column(len(q), q.shape[1], j, error)


def _draw_mode(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    k = scene.other(rng, j)
    run = scene.run
    frequency, ratio = float(rng.uniform(2.5, 5.0)), float(rng.uniform(0.01, 0.03))
    trace = mode(run.recorded.link[:, k], frequency, ratio)[run.reference.logged]
    gain = alike.sign(rng) * float(scene.noise[j] / np.sqrt(np.mean(trace**2)))
    return {"source": k + 1, "frequency": frequency, "damping_ratio": ratio, "gain": gain}


def _mode(params: Params, j: int, run: Run, q: Array) -> Array:
    """Let the structure swing on after another joint's motion."""
    swing = mode(q[:, params["source"] - 1], params["frequency"], params["damping_ratio"])
    return column(len(q), q.shape[1], j, params["gain"] * swing)


def _draw_ageing(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {
        "torque": 0.8 * scene.torque(j),
        "seconds": float(rng.uniform(0.1, 0.4)),
        "way": scene.arm.unit(j, 0.1, 0.012) * float(rng.uniform(0.5, 1.5)),
    }


def _ageing(params: Params, j: int, plant: Plant) -> Plant:
    """Friction grows while the joint rests, and wears off only along the way after it has broken loose."""
    still = plant.arm.unit(j, 2e-3, 2e-4)

    def make(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, dof: int) -> Level:
        aged = [0.0]

        def level(i: int, state: State) -> float:
            speed = abs(float(state.speed[j]))
            if speed < still:
                aged[0] += 1e-3 / params["seconds"]
            else:
                aged[0] *= 1.0 - 1e-3 * speed / params["way"]
            return float(params["torque"] * np.log1p(aged[0]))

        return level

    return plant.with_hook(friction_hook(j, make))


def _draw_cogging(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    cycles = scene.arm.unit(j, 130.0, 2160.0) * float(rng.integers(1, 4))
    return {"torque": 1.6 * scene.torque(j), "cycles": cycles, "phase": alike.phase(rng)}


def _torque_hook(j: int, torque: Callable[[State], float]) -> Callable[..., Step]:
    def hook(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant) -> Step:
        dof = int(model.joint(f"motor{j + 1}" if plant.elastic[j] else f"joint{j + 1}").dofadr[0])

        def step(i: int, t: int, state: State) -> None:
            data.qfrc_applied[dof] = torque(state)

        return step

    return hook


def _cogging(params: Params, j: int, plant: Plant) -> Plant:
    """Poles pass teeth some times a motor turn, of which 1.4 times as many also ripple."""

    def torque(state: State) -> float:
        turn = params["cycles"] * state.motor[j] + params["phase"]
        return float(params["torque"] * (np.sin(turn) + np.sin(1.4 * turn)))

    return plant.with_hook(_torque_hook(j, torque))


def _draw_rubbing(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    k = scene.other(rng, j)
    return {"source": k + 1, "torque": 1.2 * scene.torque(j), "speed": scene.arm.unit(k, 0.02, 0.003)}


def _rubbing(params: Params, j: int, plant: Plant) -> Plant:
    """Another joint's cable rubs on this one's drum and drags it along, harder as this joint winds it up."""
    low, high = plant.arm.ranges[j]

    def torque(state: State) -> float:
        wound = np.cos(5.0 * (state.motor[j] - low) / (high - low))
        return float(params["torque"] * wound * np.tanh(state.speed[params["source"] - 1] / params["speed"]))

    return plant.with_hook(_torque_hook(j, torque))


def _draw_pushes(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"force": 12.0, "every": float(rng.uniform(3.0, 6.0)), "seed": _seed(rng)}


def _pushes(params: Params, j: int, plant: Plant) -> Plant:
    """Someone leans on the tool at random moments, from anywhere, for about half a second."""

    def hook(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant) -> Step:
        time, force = reference.time, np.zeros((len(reference.time), 3))
        for moment, rng in alike.moments(params["seed"], params["every"], time[-1]):
            near = slice(*np.searchsorted(time, [moment - 1.5, moment + 1.5]))
            width, push = rng.uniform(0.15, 0.35), rng.standard_normal(3)
            force[near] += push * np.exp(-0.5 * ((time[near, None] - moment) / width) ** 2)
        tip = model.body("tip").id

        def step(i: int, t: int, state: State) -> None:
            data.xfrc_applied[tip, :3] = params["force"] * force[t]

        return step

    return plant.with_hook(hook)


def _climbing(params: Params, j: int, run: Run, q: Array) -> Array:
    """Let a cable climb over the turns of another one on a shared drum."""
    x = _span(run, q)
    wave = np.sin(4.0 * x[:, j]) * np.sin(4.0 * x[:, params["source"] - 1])
    return column(len(q), q.shape[1], j, params["amplitude"] * wave)


def _interpolation(params: Params, j: int, plant: Plant) -> Plant:
    """Unequal, unsquare tracks of an encoder: three harmonics of its period, alike in size."""
    a, n, phase = params["amplitude"], params["cycles"], params["phase"]
    waves = ((j, a, n, phase), (j, 0.9 * a, 2 * n, 2 * phase + 1.1), (j, 0.8 * a, 4 * n, 4 * phase - 0.4))
    return replace(plant, waves=(*plant.waves, *waves))


def _draw_table(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    way = rng.standard_normal(3)
    return {
        "amplitude": 3e-4,
        "axis": (way / np.linalg.norm(way)).tolist(),
        "frequency": float(rng.uniform(2.0, 4.0)),
        "hold": float(rng.uniform(0.4, 0.8)),
    }


def _table(params: Params, j: int, run: Run, T: Array) -> Array:
    """Let the table under the arm give way to its swings, stick where it came to, and slip again."""
    push = T[:, :3, 3] @ np.array(params["axis"])
    pushed = ring(push, params["frequency"], 0.15) - push
    size = float(np.sqrt(np.mean(pushed**2)))
    moved = plays(pushed, np.array([params["hold"] * size]))[:, 0] / size
    shift = params["amplitude"] * moved[:, None] * np.array(params["axis"])
    return alike.turned(T, np.zeros_like(shift), shift)


def _draw_warp(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    way = rng.standard_normal(3)
    return {
        "amplitude": 6e-4,
        "place": (way / np.linalg.norm(way) * rng.uniform(0.12, 0.2)).tolist(),
        "moment": rng.standard_normal(3).tolist(),
    }


def _warp(params: Params, j: int, run: Run, T: Array) -> Array:
    """Bend the field of a magnetic tracker by a piece of iron: the shift is that of a dipole's field."""
    place = T[:, :3, 3]
    away = place - place.mean(axis=0) - np.array(params["place"])
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    moment, unit = np.array(params["moment"]), away / distance
    field = (3.0 * unit * (unit @ moment)[:, None] - moment) * (0.15 / distance) ** 3
    return alike.turned(T, np.zeros_like(field), params["amplitude"] * field)


def _draw_cross(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"angle": 2e-3, "turn": alike.phase(rng), "source": int(rng.integers(2)) + 1}


def _cross(params: Params, j: int, run: Run, T: Array) -> Array:
    """Let a link rock across the axis of a worn bearing: it lies on one side or the other, as its load leans."""
    k = params["source"] - 1
    load = run.load[:, k] / np.abs(run.load[:, k]).max() + 0.7 * np.sin(4.0 * _span(run, run.recorded.link)[:, 1 - k])
    settled = plays(load, np.array([0.25]))[:, 0]
    lie = params["angle"] * np.tanh(4.0 * (settled - settled.mean()))
    axis = T[:, :3, 0] * np.cos(params["turn"]) + T[:, :3, 1] * np.sin(params["turn"])
    turn = lie[:, None] * axis
    return alike.turned(T, turn, np.cross(turn, T[:, :3, 3]))


def _draw_rolling(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"readout": 1.5e-3, "axis": int(rng.integers(3)), "lines": float(rng.uniform(20.0, 60.0))}


def _rolling(params: Params, j: int, run: Run, T: Array) -> Array:
    """Read a camera line by line: what is farther along its image is seen later, a delay that depends on place."""
    place = T[:, :3, 3]
    speed = np.gradient(place, run.reference.time, axis=0)
    late = params["readout"] * np.sin(params["lines"] * place[:, params["axis"]])
    return alike.turned(T, np.zeros_like(place), -late[:, None] * speed)


CAUSES = {
    "thermal_growth": Cause(_draw_growth, grow=("amplitude",), path=_growth, bare=True),
    "swaying_base": Cause(_draw_sway, where="base", grow=("angle",), build=_sway, tip=_swayed),
    "cable_derailing": Cause(_draw_derailing, grow=("amplitude",), path=_derailing, bare=True),
    "coupled_mode": Cause(_draw_mode, grow=("gain",), path=_mode, bare=True),
    "ageing_friction": Cause(_draw_ageing, grow=("torque",), build=_ageing),
    "magnetic_cogging": Cause(_draw_cogging, grow=("torque",), build=_cogging),
    "rubbing_cables": Cause(_draw_rubbing, grow=("torque",), build=_rubbing),
    "random_pushes": Cause(_draw_pushes, where="all", grow=("force",), build=_pushes),
    "climbing_cable": Cause(alike.draw_climbing, grow=("amplitude",), path=_climbing, bare=True),
    "encoder_interpolation": Cause(alike.draw_interpolation, grow=("amplitude",), build=_interpolation, bare=True),
    "wobbling_table": Cause(_draw_table, where="base", grow=("amplitude",), tip=_table, tracker_only=True),
    "field_warp": Cause(_draw_warp, where="base", grow=("amplitude",), tip=_warp, tracker_only=True),
    "cross_axis_play": Cause(_draw_cross, where="tool", grow=("angle",), tip=_cross, tracker_only=True),
    "rolling_shutter": Cause(_draw_rolling, where="base", grow=("readout",), tip=_rolling, tracker_only=True),
}
