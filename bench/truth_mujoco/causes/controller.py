"""A controller that is not the declared one: a term of its feedforward is weak or missing, or a gain is another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from truth.history import Readings

from truth_mujoco.causes.cause import Cause, Draw, Params, Scene, rms, sign
from truth_mujoco.causes.temporal import with_value_column
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant

__all__ = ["CAUSES"]

TERMS = ("gravity", "inertia", "velocity")
MOST = 1.0  # a term that is missing altogether


def _needed(term: int, j: int, scene: Scene) -> float:
    """Share of a term whose loss moves the motor by the noise."""
    run = scene.run
    rows = run.reference.logged
    speed = run.reference.speed[::2][rows, j]
    acceleration = run.reference.acceleration[::2][rows, j]
    torque = (
        scene.weight(j),
        rms(acceleration) * float(run.plant.arm.motor_inertia[j] + run.plant.link_inertia[j]),
        rms(speed) * float(run.plant.kd[j]),
    )[term]
    return scene.torque(j) / max(torque, 1e-9)


def _draw_term(term: int) -> Draw:
    return lambda rng, j, scene: {"share": -min(MOST, _needed(term, j, scene))}


def _term(term: int) -> Callable[[Params, int, Plant], Plant]:
    """Leave a share of one term out: fed = 1 + share, a negative share is missing torque.

    The velocity term holds centrifugal torques and the desired speed that the damping is told.
    """

    def build(params: Params, j: int, plant: Plant) -> Plant:
        fed = np.array(plant.fed)
        fed[term, j] += params["share"]
        return replace(plant, fed=fed)

    return build


def _draw_gain(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"gain": str(rng.choice(["kp", "kd"])), "error": sign(rng) * 0.15}


def _gain(params: Params, j: int, plant: Plant) -> Plant:
    gains = np.array(plant.gains)
    gains[("kp", "kd").index(params["gain"]), j] *= 1.0 + params["error"]
    return replace(plant, gains=gains)


def _draw_speed_noise(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    rows = scene.run.reference.logged
    return {"seconds": float(scene.noise[j]) / rms(scene.run.speed[rows, j])}


def _speed_noise(params: Params, j: int, run: Run, readings: Readings) -> Readings:
    """White noise whose standard deviation is the joint's speed times a time: an unsure sampling instant."""
    extra = np.hypot(readings.extra_noise[:, j], params["seconds"] * np.abs(run.speed[:, j]))
    return replace(readings, extra_noise=with_value_column(readings.extra_noise, j, extra))


def _of(term: int) -> Cause:
    return Cause(_draw_term(term), grow=("share",), build=_term(term), feedforward="rigid-body")


CAUSES = {
    "gravity_feedforward": _of(0),
    "inertia_feedforward": _of(1),
    "velocity_feedforward": _of(2),
    "gain_error": Cause(_draw_gain, grow=("error",), build=_gain, feedforward="none"),
    "speed_noise": Cause(_draw_speed_noise, grow=("seconds",), read=_speed_noise, bare=True, channel="noise"),
}
