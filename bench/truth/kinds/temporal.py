"""Catalogue effects of time, limits, dynamics and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.body import Body
from truth.hidden import with_column
from truth.history import History, Readings
from truth.kinds.kind import Array, Kind, Params, Scene, at, column, draw_sign, unit
from truth.loop import Loop
from truth.operators import kelvin_voigt, second_order

SLIP_SECONDS = 0.04  # a cable slips in this time


def _draw_creep(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    load = scene.load(j)
    size = max(float(np.sqrt(np.mean(load**2))), unit(j, 0.2, 0.5))
    return {
        "compliance": float(scene.noise[j]) / size,
        "time_constant": float(np.exp(rng.uniform(np.log(2), np.log(30)))),
    }


def _creep(params: Params, j: int, history: History, q: Array) -> Array:
    load = np.ascontiguousarray(history.motion.load[:, j])
    time = history.reference.time  # on through a break between sessions, in which the arm hangs at rest
    return column(len(q), j, kelvin_voigt(time, load, params["compliance"], params["time_constant"]))


def _draw_drift(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    whole = float(scene.history.reference.session_time.max())
    constant = float("inf") if rng.random() < 0.5 else whole * float(rng.uniform(0.3, 1.0))
    return {"rate": draw_sign(rng) * 1.7 * float(scene.noise[j]) / min(whole, constant), "time_constant": constant}


def _drift(params: Params, j: int, history: History, q: Array) -> Array:
    """Return the integral of `r exp(-t/T)` over the session's clock."""
    time, constant = history.reference.session_time, params["time_constant"]
    settled = time if np.isinf(constant) else constant * (1.0 - np.exp(-time / constant))
    return column(len(q), j, params["rate"] * settled)


def _draw_delay(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"delay": float(rng.uniform(0.002, 0.01))}


def delayed(values: Array, time: Array, late: Array) -> Array:
    """Values `(n, k)` as they were `late` (n,) seconds before; a gap of the clock is jumped with the arm at rest."""
    return np.column_stack([np.interp(time - late, time, v) for v in values.T])


def seen_late(readings: Readings, time: Array, late: Array) -> Readings:
    """Return what outside sensors see `late` (n,) seconds after it was so; poses are interpolated to first order."""
    tip = readings.tip
    moving = tip.strides[0] > 0  # one pose broadcast over all ticks stands for no tracker
    seen = delayed(tip.reshape(len(time), 16), time, late).reshape(tip.shape) if moving else tip
    return replace(readings, outside=delayed(readings.outside, time, late), tip=seen)


def _delay(params: Params, j: int, history: History, readings: Readings) -> Readings:
    time = history.reference.time
    late = np.full(len(time), params["delay"])
    return seen_late(readings, time, late)


def _draw_slip(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    reference = scene.history.reference
    moving = np.flatnonzero((reference.trajectory >= 0) & (np.abs(scene.history.motion.speed[:, j]) > 0))
    low, high = np.searchsorted(moving, [0.2 * moving[-1], 0.8 * moving[-1]])
    tick = int(rng.choice(moving[low:high]))
    return {
        "step": draw_sign(rng) * 1.5 * float(scene.noise[j]),
        "instant": float(reference.session_time[tick]),
        "session": int(reference.session[tick]),
    }


def _slip(params: Params, j: int, history: History, q: Array) -> Array:
    """Return an offset that comes in an instant and stays until the next homing."""
    reference = history.reference
    since = (reference.session_time - params["instant"]) / SLIP_SECONDS
    return column(len(q), j, params["step"] * np.clip(since, 0.0, 1.0) * (reference.session == params["session"]))


def _draw_saturation(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    command = np.abs(scene.history.motion.command[scene.history.reference.logged, j])
    return {"limit": float(0.97 * command.max())}


def _saturation(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(torque_limit=at(loop.torque_limit, j, params["limit"])), body


def _draw_stop(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    side = draw_sign(rng)
    share = float(rng.uniform(0.05, 0.15))  # of the samples lie beyond
    place = np.quantile(scene.path(j), 1.0 - share if side > 0 else share)
    end = "upper" if side > 0 else "lower"
    return {"stiffness": float(unit(j, 3.0, 800.0)), "limit": float(place), "end": end}


def side_of(params: Params) -> float:
    """Return 1 for a stop at the upper end, -1 at the lower."""
    return 1.0 if params["end"] == "upper" else -1.0


def _stop(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        stop_place=at(loop.stop_place, j, params["limit"]),
        stop_side=at(loop.stop_side, j, side_of(params)),
        stop_stiffness=at(loop.stop_stiffness, j, params["stiffness"]),
    )
    return changed, body


def _draw_resonance(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"frequency": float(rng.uniform(7.0, 14.0)), "damping_ratio": float(rng.uniform(0.02, 0.08))}


def _resonance(params: Params, j: int, history: History, q: Array) -> Array:
    path = np.ascontiguousarray(q[:, j])
    answer = second_order(path, 2 * np.pi * params["frequency"], params["damping_ratio"], history.step)
    return column(len(q), j, path - answer)


def _draw_quantisation(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"step": float(np.sqrt(12) * scene.noise[j])}


def _quantised(params: Params, j: int, history: History, readings: Readings) -> Readings:
    """Write positions down in steps; the controller works with finer ones."""
    counts = np.floor(readings.reported[:, j] / params["step"] + 0.5)
    return replace(readings, reported=with_column(readings.reported, j, counts * params["step"]))


def _draw_noise(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a moment between two trajectories of a session, from a quarter to a half of it, of every session."""
    reference = scene.history.reference
    first = reference.session == 0
    number = reference.trajectory[first].max() + 1
    begins = int(rng.integers(number // 4, number // 2 + 1))
    since = reference.session_time[first & (reference.trajectory == begins)][0]
    return {"std": float(scene.noise[j]), "since": float(since)}


def _noise(params: Params, j: int, history: History, readings: Readings) -> Readings:
    """From a moment on, more noise, white and normal."""
    later = history.reference.session_time >= params["since"]
    extra = np.hypot(readings.extra_noise[:, j], np.where(later, params["std"], 0.0))
    return replace(readings, extra_noise=with_column(readings.extra_noise, j, extra))


KINDS = {
    "creep": Kind(_draw_creep, grow=("compliance",), path=_creep),
    "drift": Kind(_draw_drift, grow=("rate",), path=_drift, bare=True),
    "delay": Kind(_draw_delay, where="all", grow=("delay",), read=_delay, bare=True),
    "cable_slip": Kind(_draw_slip, grow=("step",), path=_slip, bare=True),
    "torque_saturation": Kind(_draw_saturation, shrink=("limit",), power={"limit": 0.05}, loop=_saturation, peaks=True),
    "joint_stop": Kind(_draw_stop, grow=("stiffness",), loop=_stop, peaks=True),
    "resonance": Kind(_draw_resonance, shrink=("frequency",), power={"frequency": 0.5}, path=_resonance, bare=True),
    "encoder_quantisation": Kind(_draw_quantisation, grow=("step",), read=_quantised, bare=True, channel="reported"),
    "noise_change": Kind(_draw_noise, grow=("std",), read=_noise, bare=True, channel="noise"),
}
