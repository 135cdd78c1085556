"""What gives way under load: cables as tendons between motor and link, payload, a shaft on springs, remote centre."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from truth import alike
from truth.kinds.kind import at
from truth.reference import Reference

from truth_mujoco.body import TOOL_ARMATURE, kinematics, tips
from truth_mujoco.causes.cause import Array, Cause, Params, Scene, column
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant, State

BEND_DAMPING = 0.3  # of critical


def _elastic(plant: Plant, j: int, stiffness: float, cubic: float = 0.0) -> Plant:
    elastic = at(plant.elastic, j, True)
    k, k3 = at(plant.stiffness, j, stiffness), at(plant.cubic, j, cubic)
    return replace(plant, elastic=elastic, stiffness=k, cubic=k3)


def _stretch(params: Params, j: int, plant: Plant) -> Plant:
    return _elastic(plant, j, params["stiffness"])


def _nonlinear(params: Params, j: int, plant: Plant) -> Plant:
    return _elastic(plant, j, params["stiffness"], params["cubic"])


def _draw_length(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a cable whose free length is the insertion and a constant, as the insertion's zero is a convention."""
    middle = float(scene.arm.ranges[2].mean())
    length = float(rng.uniform(0.03, 0.25)) - float(scene.arm.ranges[2, 0])
    return {"source": 3, "rigidity": (middle + length) * alike.typical_stiffness(j, scene), "length": length}


def _length(params: Params, j: int, plant: Plant) -> Plant:
    middle = float(plant.arm.ranges[2].mean())
    changed = _elastic(plant, j, params["rigidity"] / (middle + params["length"]))

    def hook(
        model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant
    ) -> Callable[[int, int, State], None]:
        cable, source = model.tendon(f"cable{j + 1}").id, params["source"] - 1

        def step(i: int, t: int, state: State) -> None:
            model.tendon_stiffness[cable] = params["rigidity"] / (params["length"] + data.qpos[source])

        return step

    return changed.with_hook(hook)


def _sag(params: Params, j: int, run: Run, q: Array) -> Array:
    return column(len(q), q.shape[1], j, run.weight[:, j] / params["stiffness"])


def _draw_payload(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"mass": float(rng.uniform(0.05, 0.2))}


def _payload(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, hidden_mass=plant.hidden_mass + params["mass"])


def _bending(params: Params, j: int, plant: Plant) -> Plant:
    """Hang the payload on two slides across the shaft, each a spring of 3 EI / L^3 as the insertion goes."""
    middle = plant.arm.ranges.mean(axis=1)[None]
    T = tips(kinematics(plant.arm, plant.rows), middle)[0]
    along = T[:3, :3].T @ (T[:3, 3] / np.linalg.norm(T[:3, 3]))
    across = np.linalg.svd(along[None])[2][1:]

    def hook(
        model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant
    ) -> Callable[[int, int, State], None]:
        tip = model.body("tip").id
        slides = [model.joint(f"bend{i}").id for i in range(2)]
        dofs = [model.joint(f"bend{i}").dofadr[0] for i in range(2)]

        def step(i: int, t: int, state: State) -> None:
            length = float(np.linalg.norm(data.xpos[tip]))
            stiffness = 3.0 * params["rigidity"] / length**3
            mass = TOOL_ARMATURE + reference.payload[t]
            model.jnt_stiffness[slides] = stiffness
            model.dof_damping[dofs] = 2 * BEND_DAMPING * np.sqrt(stiffness * mass)

        return step

    return replace(plant, bends=across).with_hook(hook)


def _bent(params: Params, j: int, run: Run, T: Array) -> Array:
    """Turn a cantilever under an end force by 3 / (2 L) times what its end moves."""
    place = T[:, :3, 3]
    length = np.linalg.norm(place, axis=1, keepdims=True)
    turn = np.cross(place / length, 1.5 * run.recorded.bend / length)
    return alike.turned(T, turn, run.recorded.bend)


def _rcm(params: Params, j: int, run: Run, T: Array) -> Array:
    return alike.turned(
        T, np.zeros((len(T), 3)), alike.lateral_force(run.reference.payload, run.plant.gravity, T) / params["stiffness"]
    )


CAUSES = {
    "cable_stretch": Cause(alike.draw_stretch, shrink=("stiffness",), build=_stretch),
    "nonlinear_stretch": Cause(
        alike.draw_nonlinear, shrink=("stiffness", "cubic"), power={"cubic": 3.0}, build=_nonlinear
    ),
    "length_dependent_stiffness": Cause(_draw_length, shrink=("rigidity",), build=_length),
    "gravity_sag": Cause(alike.draw_sag, shrink=("stiffness",), path=_sag),
    "payload": Cause(_draw_payload, where="all", grow=("mass",), build=_payload),
    "shaft_bending": Cause(
        alike.draw_bending, where="tool", shrink=("rigidity",), build=_bending, tip=_bent, tracker_only=True
    ),
    "rcm_shift": Cause(alike.draw_rcm, where="base", shrink=("stiffness",), tip=_rcm, tracker_only=True),
}
