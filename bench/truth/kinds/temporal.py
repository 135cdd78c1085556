"""Catalogue effects of time, limits, dynamics and sensors."""

from __future__ import annotations

import numpy as np

from truth import alike
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, at, column
from truth.loop import Loop
from truth.operators import kelvin_voigt, second_order

SLIP_SECONDS = 0.04  # a cable slips in this time


def _creep(params: Params, j: int, history: History, q: Array) -> Array:
    load = np.ascontiguousarray(history.motion.load[:, j])
    time = history.reference.time  # on through a break between sessions, in which the arm hangs at rest
    return column(len(q), j, kelvin_voigt(time, load, params["compliance"], params["time_constant"]))


def _drift(params: Params, j: int, history: History, q: Array) -> Array:
    """Return the integral of `r exp(-t/T)` over the session's clock."""
    time, constant = history.reference.session_time, params["time_constant"]
    settled = time if np.isinf(constant) else constant * (1.0 - np.exp(-time / constant))
    return column(len(q), j, params["rate"] * settled)


def _slip(params: Params, j: int, history: History, q: Array) -> Array:
    """Return an offset that comes in an instant and stays until the next homing."""
    reference = history.reference
    since = (reference.session_time - params["instant"]) / SLIP_SECONDS
    return column(len(q), j, params["step"] * np.clip(since, 0.0, 1.0) * (reference.session == params["session"]))


def _saturation(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(torque_limit=at(loop.torque_limit, j, params["limit"])), body


def _stop(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        stop_place=at(loop.stop_place, j, params["limit"]),
        stop_side=at(loop.stop_side, j, alike.side_of(params)),
        stop_stiffness=at(loop.stop_stiffness, j, params["stiffness"]),
    )
    return changed, body


def _resonance(params: Params, j: int, history: History, q: Array) -> Array:
    path = np.ascontiguousarray(q[:, j])
    answer = second_order(path, 2 * np.pi * params["frequency"], params["damping_ratio"], history.step)
    return column(len(q), j, path - answer)


KINDS = {
    "creep": Kind(alike.draw_creep, grow=("compliance",), path=_creep),
    "drift": Kind(alike.draw_drift, grow=("rate",), path=_drift, bare=True),
    "delay": Kind(alike.draw_delay, where="all", grow=("delay",), read=alike.delay, bare=True),
    "cable_slip": Kind(alike.draw_slip, grow=("step",), path=_slip, bare=True),
    "torque_saturation": Kind(
        alike.draw_saturation, shrink=("limit",), power={"limit": 0.05}, loop=_saturation, peaks=True
    ),
    "joint_stop": Kind(alike.draw_stop, grow=("stiffness",), loop=_stop, peaks=True),
    "resonance": Kind(
        alike.draw_resonance, shrink=("frequency",), power={"frequency": 0.5}, path=_resonance, bare=True
    ),
    "encoder_quantisation": Kind(
        alike.draw_quantisation, grow=("step",), read=alike.quantised, bare=True, channel="reported"
    ),
    "noise_change": Kind(alike.draw_noise, grow=("std",), read=alike.noisier, bare=True, channel="noise"),
}
