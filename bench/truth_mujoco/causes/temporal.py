"""Time, limits, dynamics and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from truth import alike
from truth.kinds.kind import at
from truth.reference import Reference

from truth_mujoco.causes.cause import Array, Cause, Params, column
from truth_mujoco.motion import Run
from truth_mujoco.plant import PER_TICK, Plant
from truth_mujoco.stages import ring, strain


def _creep(params: Params, j: int, run: Run, q: Array) -> Array:
    slow = strain(run.load[:, j], run.reference.time, params["compliance"], params["time_constant"])
    return column(len(q), q.shape[1], j, slow)


def _drift(params: Params, j: int, plant: Plant) -> Plant:
    constant = params["time_constant"]

    def more(reference: Reference, time: Array) -> Array:
        settled = time if np.isinf(constant) else -constant * np.expm1(-time / constant)
        return column(len(time), plant.arm.dof, j, params["rate"] * settled)

    return plant.with_offset(more)


def _slip(params: Params, j: int, plant: Plant) -> Plant:
    """Turn the drum under the cable at one instant; the encoder counts on."""

    def more(reference: Reference, time: Array) -> Array:
        here = np.repeat(reference.session, PER_TICK) == params["session"]
        return column(len(time), plant.arm.dof, j, params["step"] * (here & (time >= params["instant"])))

    return plant.with_offset(more)


def _saturation(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, torque_limit=at(plant.torque_limit, j, params["limit"]))


def _stop(params: Params, j: int, plant: Plant) -> Plant:
    return replace(
        plant,
        stop_place=at(plant.stop_place, j, params["limit"]),
        stop_side=at(plant.stop_side, j, alike.side_of(params)),
        stop_stiffness=at(plant.stop_stiffness, j, params["stiffness"]),
    )


def _resonance(params: Params, j: int, run: Run, q: Array) -> Array:
    return column(len(q), q.shape[1], j, q[:, j] - ring(q[:, j], params["frequency"], params["damping_ratio"]))


CAUSES = {
    "creep": Cause(alike.draw_creep, grow=("compliance",), path=_creep),
    "drift": Cause(alike.draw_drift, grow=("rate",), build=_drift, bare=True),
    "delay": Cause(alike.draw_delay, where="all", grow=("delay",), read=alike.delay, bare=True),
    "cable_slip": Cause(alike.draw_slip, grow=("step",), build=_slip, bare=True),
    "torque_saturation": Cause(
        alike.draw_saturation, shrink=("limit",), power={"limit": 0.05}, build=_saturation, peaks=True
    ),
    "joint_stop": Cause(alike.draw_stop, grow=("stiffness",), build=_stop, peaks=True),
    "resonance": Cause(
        alike.draw_resonance, shrink=("frequency",), power={"frequency": 0.5}, path=_resonance, bare=True
    ),
    "encoder_quantisation": Cause(
        alike.draw_quantisation, grow=("step",), read=alike.quantised, bare=True, channel="reported"
    ),
    "noise_change": Cause(alike.draw_noise, grow=("std",), read=alike.noisier, bare=True, channel="noise"),
}
