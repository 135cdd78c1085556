"""Time, limits, dynamics and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from truth.hidden import with_column
from truth.history import Readings
from truth.reference import Reference

from truth_mujoco.causes.cause import Array, Cause, Params, Scene, column, sign
from truth_mujoco.motion import Run
from truth_mujoco.plant import PER_TICK, Plant, with_value
from truth_mujoco.stages import ring, strain


def _draw_creep(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    seconds = float(np.exp(rng.uniform(np.log(2), np.log(30))))
    return {"compliance": float(scene.noise[j]) / scene.load(j), "time_constant": seconds}


def _creep(params: Params, j: int, run: Run, q: Array) -> Array:
    slow = strain(run.load[:, j], run.reference.time, params["compliance"], params["time_constant"])
    return column(len(q), q.shape[1], j, slow)


def _draw_drift(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    whole = float(scene.run.reference.session_time.max())
    constant = float("inf") if rng.random() < 0.5 else whole * float(rng.uniform(0.3, 1.0))
    return {"rate": sign(rng) * 1.7 * float(scene.noise[j]) / min(whole, constant), "time_constant": constant}


def _drift(params: Params, j: int, plant: Plant) -> Plant:
    constant = params["time_constant"]

    def more(reference: Reference, time: Array) -> Array:
        settled = time if np.isinf(constant) else -constant * np.expm1(-time / constant)
        return column(len(time), plant.arm.dof, j, params["rate"] * settled)

    return plant.with_offset(more)


def _draw_slip(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    reference = scene.run.reference
    moving = np.flatnonzero((reference.trajectory >= 0) & (np.abs(scene.run.speed[:, j]) > 1e-6))
    low, high = np.searchsorted(moving, [0.2 * moving[-1], 0.8 * moving[-1]])
    tick = int(rng.choice(moving[low:high]))
    return {
        "step": sign(rng) * 1.5 * float(scene.noise[j]),
        "instant": float(reference.session_time[tick]),
        "session": int(reference.session[tick]),
    }


def _slip(params: Params, j: int, plant: Plant) -> Plant:
    """Turn the drum under the cable at one instant; the encoder counts on."""

    def more(reference: Reference, time: Array) -> Array:
        here = np.repeat(reference.session, PER_TICK) == params["session"]
        return column(len(time), plant.arm.dof, j, params["step"] * (here & (time >= params["instant"])))

    return plant.with_offset(more)


def _draw_delay(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"delay": float(rng.uniform(0.002, 0.01))}


def _delay(params: Params, j: int, run: Run, readings: Readings) -> Readings:
    """Sensors outside see what was so a while ago; a gap of the clock is jumped with the arm at rest."""
    time = run.reference.time
    seen = [readings.outside]
    tracked = readings.tip.strides[0] > 0  # one pose for all ticks stands for no tracker
    if tracked:
        seen.append(readings.tip.reshape(len(time), 16))
    late = [np.column_stack([np.interp(time - params["delay"], time, v) for v in values.T]) for values in seen]
    tip = late[1].reshape(readings.tip.shape) if tracked else readings.tip
    return replace(readings, outside=late[0], tip=tip)


def _draw_saturation(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    command = np.abs(scene.run.recorded.command[scene.run.reference.logged, j])
    return {"limit": float(0.97 * command.max())}


def _saturation(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, torque_limit=with_value(plant.torque_limit, j, params["limit"]))


def _draw_stop(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    side, share = sign(rng), float(rng.uniform(0.05, 0.15))  # of the samples lie beyond
    place = float(np.quantile(scene.path(j), 1.0 - share if side > 0 else share))
    stiffness = 0.02 * float(scene.run.plant.kp[j])
    return {"stiffness": stiffness, "limit": place, "end": "upper" if side > 0 else "lower"}


def _stop(params: Params, j: int, plant: Plant) -> Plant:
    side = 1.0 if params["end"] == "upper" else -1.0
    return replace(
        plant,
        stop_place=with_value(plant.stop_place, j, params["limit"]),
        stop_side=with_value(plant.stop_side, j, side),
        stop_stiffness=with_value(plant.stop_stiffness, j, params["stiffness"]),
    )


def _draw_resonance(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"frequency": float(rng.uniform(7.0, 14.0)), "damping_ratio": float(rng.uniform(0.02, 0.08))}


def _resonance(params: Params, j: int, run: Run, q: Array) -> Array:
    return column(len(q), q.shape[1], j, q[:, j] - ring(q[:, j], params["frequency"], params["damping_ratio"]))


def _draw_quantisation(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"step": float(np.sqrt(12) * scene.noise[j])}


def _quantised(params: Params, j: int, run: Run, readings: Readings) -> Readings:
    """Write positions down in steps; the controller works with finer ones."""
    counts = np.floor(readings.reported[:, j] / params["step"] + 0.5)
    return replace(readings, reported=with_column(readings.reported, j, counts * params["step"]))


def _draw_noise(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a moment between two trajectories of a session, from a quarter to a half of it, of every session."""
    reference = scene.run.reference
    first = reference.session == 0
    number = reference.trajectory[first].max() + 1
    begins = int(rng.integers(number // 4, number // 2 + 1))
    since = reference.session_time[first & (reference.trajectory == begins)][0]
    return {"std": float(scene.noise[j]), "since": float(since)}


def _noise(params: Params, j: int, run: Run, readings: Readings) -> Readings:
    """From a moment on, more noise, white and normal."""
    later = run.reference.session_time >= params["since"]
    extra = np.hypot(readings.extra_noise[:, j], np.where(later, params["std"], 0.0))
    return replace(readings, extra_noise=with_column(readings.extra_noise, j, extra))


CAUSES = {
    "creep": Cause(_draw_creep, grow=("compliance",), path=_creep),
    "drift": Cause(_draw_drift, grow=("rate",), build=_drift, bare=True),
    "delay": Cause(_draw_delay, where="all", grow=("delay",), read=_delay, bare=True),
    "cable_slip": Cause(_draw_slip, grow=("step",), build=_slip, bare=True),
    "torque_saturation": Cause(
        _draw_saturation, shrink=("limit",), power={"limit": 0.05}, build=_saturation, peaks=True
    ),
    "joint_stop": Cause(_draw_stop, grow=("stiffness",), build=_stop, peaks=True),
    "resonance": Cause(_draw_resonance, shrink=("frequency",), power={"frequency": 0.5}, path=_resonance, bare=True),
    "encoder_quantisation": Cause(_draw_quantisation, grow=("step",), read=_quantised, bare=True, channel="reported"),
    "noise_change": Cause(_draw_noise, grow=("std",), read=_noise, bare=True, channel="noise"),
}
