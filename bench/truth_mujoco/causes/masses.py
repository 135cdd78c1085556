"""An arm that weighs otherwise than is declared: a link, its centre of mass, gravity, a motor, a spring at a joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from truth import alike

from truth_mujoco.body import link_frame
from truth_mujoco.causes.cause import Cause, Params, Scene
from truth_mujoco.plant import Plant

G = 9.80665


def _built_in(change: Callable[[mujoco.MjSpec, Params, int, Plant], None]) -> Callable[[Params, int, Plant], Plant]:
    """Return what builds a change into the model that moves; the controller keeps to the declared one."""

    def build(params: Params, j: int, plant: Plant) -> Plant:
        return replace(plant, shapes=(*plant.shapes, lambda spec: change(spec, params, j, plant)))

    return build


def _draw_mass(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"mass": alike.sign(rng) * 0.3 * float(scene.arm.mass[j])}


def _mass(spec: mujoco.MjSpec, params: Params, j: int, plant: Plant) -> None:
    spec.body(f"link{j + 1}").mass += params["mass"]


def _draw_centre(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    needed = scene.torque(j) / (G * float(scene.arm.mass[j]))
    return dict(zip("xyz", (needed * rng.standard_normal(3)).tolist(), strict=True))


def _centre(spec: mujoco.MjSpec, params: Params, j: int, plant: Plant) -> None:
    body, R = spec.body(f"link{j + 1}"), link_frame(plant.arm, plant.rows, j)[:3, :3]
    body.ipos = body.ipos + R @ [params["x"], params["y"], params["z"]]


def _draw_gravity(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return dict(zip("xyz", (0.3 * rng.standard_normal(3)).tolist(), strict=True))


def _gravity(spec: mujoco.MjSpec, params: Params, j: int, plant: Plant) -> None:
    spec.option.gravity = spec.option.gravity + np.array([params["x"], params["y"], params["z"]])


def _draw_inertia(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"inertia": 0.3 * float(scene.arm.motor_inertia[j])}


def _inertia(spec: mujoco.MjSpec, params: Params, j: int, plant: Plant) -> None:
    spec.joint(f"joint{j + 1}").armature += params["inertia"]


def _draw_spring(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    stiffness = alike.sign(rng) * scene.torque(j) / alike.rms(scene.path(j))
    return {"stiffness": stiffness, "push": float(rng.standard_normal()) * scene.torque(j)}


def _spring(spec: mujoco.MjSpec, params: Params, j: int, plant: Plant) -> None:
    joint = spec.joint(f"joint{j + 1}")
    joint.stiffness, joint.springref = [params["stiffness"], 0.0, 0.0], -params["push"] / params["stiffness"]


CAUSES = {
    "link_mass_error": Cause(_draw_mass, grow=("mass",), build=_built_in(_mass)),
    "centre_of_mass_error": Cause(_draw_centre, grow=("x", "y", "z"), build=_built_in(_centre)),
    "gravity_error": Cause(_draw_gravity, where="base", grow=("x", "y", "z"), build=_built_in(_gravity)),
    "inertia_error": Cause(_draw_inertia, grow=("inertia",), build=_built_in(_inertia)),
    "joint_spring": Cause(_draw_spring, grow=("stiffness", "push"), build=_built_in(_spring)),
}
