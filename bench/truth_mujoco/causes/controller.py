"""A controller that is not the declared one: a term of its feedforward is weak or missing, or a gain is another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from truth import alike
from truth.hidden import with_column
from truth.history import Readings

from truth_mujoco.causes.cause import Cause, Params, Scene
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant

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
        alike.rms(acceleration) * float(run.plant.arm.motor_inertia[j] + run.plant.link_inertia[j]),
        alike.rms(speed) * float(run.plant.kd[j]),
    )[term]
    return scene.torque(j) / max(torque, 1e-9)


def _draw_term(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    term = int(rng.integers(len(TERMS)))
    return {"term": TERMS[term], "fraction": -min(MOST, _needed(term, j, scene))}


def _term(params: Params, j: int, plant: Plant) -> Plant:
    """Feed a further fraction of one term forward; a negative one is missing.

    The velocity term is the desired speed that the damping is told.
    """
    fed = np.array(plant.fed)
    fed[TERMS.index(params["term"]), j] += params["fraction"]
    return replace(plant, fed=fed)


def _draw_gains(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"proportional": alike.sign(rng) * 0.15, "derivative": alike.sign(rng) * float(rng.uniform(0.0, 0.15))}


def _gains(params: Params, j: int, plant: Plant) -> Plant:
    gains = np.array(plant.gains)
    gains[:, j] *= 1.0 + np.array([params["proportional"], params["derivative"]])
    return replace(plant, gains=gains)


def _draw_speed_noise(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    rows = scene.run.reference.logged
    return {"seconds": float(scene.noise[j]) / alike.rms(scene.run.speed[rows, j])}


def _speed_noise(params: Params, j: int, run: Run, readings: Readings) -> Readings:
    """White noise whose standard deviation is the joint's speed times a time: an unsure sampling instant."""
    extra = np.hypot(readings.extra_noise[:, j], params["seconds"] * np.abs(run.speed[:, j]))
    return replace(readings, extra_noise=with_column(readings.extra_noise, j, extra))


CAUSES = {
    "feedforward_error": Cause(_draw_term, grow=("fraction",), build=_term, feedforward="rigid-body"),
    "gain_error": Cause(_draw_gains, grow=("proportional", "derivative"), build=_gains, feedforward="none"),
    "speed_noise": Cause(_draw_speed_noise, grow=("seconds",), read=_speed_noise, bare=True, channel="noise"),
}
