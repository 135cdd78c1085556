"""Direction of motion: slack, hysteresis as several slacks, dry friction by MuJoCo's frictionloss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from truth import alike
from truth.kinds.kind import at
from truth.reference import Reference

from truth_mujoco.causes.cause import Array, Cause, Params, Scene, column
from truth_mujoco.motion import Run
from truth_mujoco.plant import Plant, State
from truth_mujoco.stages import plays

LOOPS = np.array([0.15, 0.4, 1.0, 2.2])  # radii of the elements of a hysteresis, in parts of its width
Level = Callable[[int, State], float]


def friction_hook(
    j: int, make: Callable[[mujoco.MjModel, mujoco.MjData, Reference, int], Level]
) -> Callable[..., object]:
    """Return a hook that sets the dry friction of column j anew at each control step."""

    def hook(
        model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, plant: Plant
    ) -> Callable[[int, int, State], None]:
        joint = f"motor{j + 1}" if plant.elastic[j] else f"joint{j + 1}"
        dof = int(model.joint(joint).dofadr[0])
        level = make(model, data, reference, dof)

        def step(i: int, t: int, state: State) -> None:
            model.dof_frictionloss[dof] = level(i, state)

        return step

    return hook


def _backlash(params: Params, j: int, run: Run, q: Array) -> Array:
    return column(len(q), q.shape[1], j, q[:, j] - plays(q[:, j], np.array([params["radius"]]))[:, 0])


def _draw_hysteresis(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    depth = float(np.exp(rng.uniform(np.log(0.15), 0.0)))
    shares = rng.dirichlet(np.full(len(LOOPS), 2.0))
    return {"width": float(2.5 * scene.noise[j] / depth), "depth": depth, "shares": shares.tolist()}


def _hysteresis(params: Params, j: int, run: Run, q: Array) -> Array:
    """Maxwell slip: elements of different slack side by side, whose places add up by their shares."""
    places = plays(q[:, j], params["width"] * LOOPS)
    lag = (q[:, [j]] - places) @ (params["depth"] * np.array(params["shares"]))
    return column(len(q), q.shape[1], j, lag)


def _coulomb(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, coulomb=at(plant.coulomb, j, params["torque"]))


def _viscous(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, viscous=at(plant.viscous, j, params["damping"]))


def _stribeck(params: Params, j: int, plant: Plant) -> Plant:
    def make(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, dof: int) -> Level:
        rise = params["static_torque"] - params["torque"]
        return lambda i, state: params["torque"] + rise * float(np.exp(-((state.speed[j] / params["speed"]) ** 2)))

    return plant.with_hook(friction_hook(j, make))


def _capstan(params: Params, j: int, plant: Plant) -> Plant:
    """More tension is lost when the load is lifted than when it is let down."""
    lift, lower = float(np.expm1(params["wrap"])), float(-np.expm1(-params["wrap"]))
    still = plant.arm.unit(j, 1e-3, 1e-4)

    def make(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, dof: int) -> Level:
        armature = plant.arm.motor_inertia[j]

        def level(i: int, state: State) -> float:
            load = data.qfrc_actuator[dof] + data.qfrc_constraint[dof] + data.qfrc_passive[dof]
            load -= armature * data.qacc[dof]
            speed = state.speed[j] if abs(state.speed[j]) > still else reference.speed[i, j]
            return float(abs(load) * (lift if speed * load >= 0.0 else lower))

        return level

    return plant.with_hook(friction_hook(j, make))


def _wavy(params: Params, j: int, plant: Plant) -> Plant:
    def make(model: mujoco.MjModel, data: mujoco.MjData, reference: Reference, dof: int) -> Level:
        def level(i: int, state: State) -> float:
            wave = np.sin(params["waves"] * state.motor[j] + params["phase"])
            return float(max(0.0, params["torque"] + params["swing"] * wave))

        return level

    return plant.with_hook(friction_hook(j, make))


CAUSES = {
    "backlash": Cause(alike.draw_backlash, grow=("radius",), path=_backlash, bare=True),
    "coulomb_friction": Cause(alike.draw_coulomb, grow=("torque",), build=_coulomb),
    "viscous_friction": Cause(alike.draw_viscous, grow=("damping",), build=_viscous),
    "stribeck_friction": Cause(alike.draw_stribeck, grow=("torque", "static_torque"), build=_stribeck),
    "capstan_friction": Cause(alike.draw_capstan, grow=("wrap",), build=_capstan),
    "position_dependent_friction": Cause(alike.draw_wavy, grow=("torque", "swing"), build=_wavy),
    "hysteresis": Cause(_draw_hysteresis, grow=("width",), path=_hysteresis, bare=True),
}
